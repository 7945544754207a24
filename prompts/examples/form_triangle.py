"""Pattern: a triangle of blocks; a pattern in its own frame, moved and turned as a whole by utils.multiply."""

import numpy as np

from grs_agents.sim import Task, utils


class FormTriangle(Task):
    """Lay three red blocks at the corners of a triangle and three blue ones at the middles of its sides."""

    def __init__(self):
        super().__init__()
        self.max_steps = 12
        self.lang_template = "put the {} blocks at the {} of the triangle"
        self.task_completed_desc = "the triangle is complete."
        self.additional_reset()

    def reset(self, env):
        super().reset(env)
        side = 0.04
        turn = utils.eulerXYZ_to_quatXYZW((0, 0, float(env.rng.uniform(-np.pi, np.pi))))
        frame = ((0.48, float(env.rng.uniform(-0.2, 0.2)), 0.0), turn)
        mat = self.fill_template("zone/zone-template.urdf", {"DIM": (0.30, 0.30, 0.002), "COLOR": utils.COLORS["gray"]})
        env.add_object(mat, frame, "fixed")

        corners = [np.array([0.12 * np.cos(angle), 0.12 * np.sin(angle), side / 2]) for angle in (0, 2.094, 4.189)]
        middles = [(corners[index] + corners[index - 1]) / 2 for index in range(3)]
        for color, points, word in (("red", corners, "corners"), ("blue", middles, "middle of each side")):
            blocks = []
            for _ in points:
                pose = self.get_random_pose(env, (side, side, side))
                blocks.append(env.add_object(f"block/{color}_block.urdf", pose))
            self.add_goal(
                objs=blocks,
                matches=np.ones((len(blocks), len(points))),
                targ_poses=[utils.multiply(frame, (point, (0, 0, 0, 1))) for point in points],
                replace=False,
                rotations=False,
                metric="pose",
                params=None,
                step_max_reward=1 / 2,
                symmetries=[0] * len(blocks),
                language_goal=self.lang_template.format(color, word),
            )
