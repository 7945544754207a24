"""Alignment: along a line on the table, in the order that is asked for, at even distances."""

import numpy as np

from grs_agents.sim import Task, utils


class AlignBlocksOnLine(Task):
    """Lay the blocks on the green line in the order of the colours named."""

    def __init__(self):
        super().__init__()
        self.max_steps = 10
        self.lang_template = "put the {} block at place {} of the line"
        self.task_completed_desc = "all blocks are on the line."
        self.additional_reset()

    def reset(self, env):
        super().reset(env)
        side, pitch = 0.04, 0.07
        colors = env.rng.permutation(["red", "orange", "yellow", "blue", "purple"])
        length = pitch * len(colors)
        yaw = float(env.rng.uniform(-np.pi / 2, np.pi / 2))
        line_pose = ((0.48, float(env.rng.uniform(-0.15, 0.15)), 0.001), utils.eulerXYZ_to_quatXYZW((0, 0, yaw)))
        line = self.fill_template(
            "line/line-template.urdf", {"DIM": (length, 0.01, 0.001), "COLOR": utils.COLORS["green"]}
        )
        env.add_object(line, line_pose, "fixed")

        for index, color in enumerate(colors):
            offset = ((index - (len(colors) - 1) / 2) * pitch, 0, side / 2)
            pose = self.get_random_pose(env, (side, side, side))
            self.add_goal(
                objs=[env.add_object(f"block/{color}_block.urdf", pose)],
                matches=np.ones((1, 1)),
                targ_poses=[utils.multiply(line_pose, (offset, (0, 0, 0, 1)))],
                replace=False,
                rotations=True,
                metric="pose",
                params=None,
                step_max_reward=1 / len(colors),
                symmetries=[np.pi / 2],
                language_goal=self.lang_template.format(color, index + 1),
            )
