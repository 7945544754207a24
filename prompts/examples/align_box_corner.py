"""Alignment: the corner of a box of random size to a right angle on the table, which is drawn to fit it."""

import numpy as np

from grs_agents.sim import Task, utils


class AlignBoxCorner(Task):
    """Align each of the two boxes with the right angle of its colour."""

    def __init__(self):
        super().__init__()
        self.max_steps = 5
        self.lang_template = "align the {0} box with the {0} corner"
        self.task_completed_desc = "done with alignment."
        self.additional_reset()

    def reset(self, env):
        super().reset(env)
        colors = ["red", "blue"]
        sizes = [self.get_random_size(0.06, 0.12, 0.06, 0.12, 0.04, 0.06) for _ in colors]
        corners = []
        for color, side, (x, y, z) in zip(colors, (0.25, -0.25), sizes, strict=True):
            position = (float(env.rng.uniform(0.35, 0.60)), side, z / 2)
            rotation = utils.eulerXYZ_to_quatXYZW((0, 0, float(env.rng.uniform(-np.pi, np.pi))))
            # Two strokes, 5 mm wide and 5.5 cm long, along the far sides of a box that stands there.
            strokes = {"DIMX": (x / 2 - 0.0225, x / 2 + 0.0025), "DIMY": (y / 2 + 0.0025, y / 2 - 0.0225)}
            corner = self.fill_template("corner/corner-template.urdf", {**strokes, "COLOR": utils.COLORS[color]})
            env.add_object(corner, ((*position[:2], 0.001), rotation), "fixed")
            corners.append((position, rotation))

        for color, size, target in zip(colors, sizes, corners, strict=True):
            box = self.fill_template("box/box-template.urdf", {"DIM": size, "COLOR": utils.COLORS[color]})
            self.add_goal(
                objs=[env.add_object(box, self.get_random_pose(env, size))],
                matches=np.ones((1, 1)),
                targ_poses=[target],
                replace=False,
                rotations=True,
                metric="pose",
                params=None,
                step_max_reward=1 / len(colors),
                symmetries=[np.pi],
                language_goal=self.lang_template.format(color),
            )
