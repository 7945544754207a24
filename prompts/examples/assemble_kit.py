"""Kitting: flat shapes onto their outlines on a board; the yaw counts, symmetry 2 pi, and a template takes a mesh."""

import numpy as np

from grs_agents.sim import Task, utils


class AssembleKit(Task):
    """Lay each of the four shapes onto its outline on the board."""

    def __init__(self):
        super().__init__()
        self.max_steps = 8
        self.lang_template = "lay the {} shape onto its outline"
        self.task_completed_desc = "the kit is complete."
        self.additional_reset()

    def reset(self, env):
        super().reset(env)
        board_size = env.library.asset("kitting/kit.urdf").size
        board_pose = self.get_random_pose(env, board_size)
        env.add_object("kitting/kit.urdf", board_pose, "fixed")

        shapes = env.rng.choice(self.train_set, 4, replace=False)
        colors = ["red", "green", "blue", "yellow"]
        # The origin of a shape lies in its underside, unlike a block's.
        spots = [(x, y) for x in (-0.07, 0.07) for y in (-0.05, 0.05)]
        for shape, color, (x, y) in zip(shapes, colors, spots, strict=True):
            name, yaw = f"{shape:02d}.obj", float(env.rng.uniform(-np.pi, np.pi))
            rotation = utils.eulerXYZ_to_quatXYZW((0, 0, yaw))
            outline = {"FNAME": (name,), "SCALE": (0.003, 0.003, 0.0001), "COLOR": (0.2, 0.2, 0.2)}
            mark = self.fill_template("kitting/object-template-nocollision.urdf", outline)
            env.add_object(mark, utils.multiply(board_pose, ((x, y, board_size[2] / 2), rotation)), "fixed")

            values = {"FNAME": (name,), "SCALE": (0.003, 0.003, 0.001), "COLOR": utils.COLORS[color]}
            piece = self.fill_template("kitting/object-template.urdf", values)
            obj = env.add_object(piece, self.get_random_pose(env, (0.08, 0.08, 0.02)))
            self.add_goal(
                objs=[obj],
                matches=np.ones((1, 1)),
                targ_poses=[utils.multiply(board_pose, ((x, y, board_size[2] / 2), rotation))],
                replace=False,
                rotations=True,
                metric="pose",
                params=None,
                step_max_reward=1 / len(shapes),
                symmetries=[2 * np.pi],
                language_goal=self.lang_template.format(color),
            )
