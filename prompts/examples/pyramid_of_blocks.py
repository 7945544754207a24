"""Pyramid: rows of three, two and one block; the blocks of a row may change places."""

import numpy as np

from grs_agents.sim import Task, utils


class PyramidOfBlocks(Task):
    """Build a pyramid: three blocks below, two on them, one on top."""

    def __init__(self):
        super().__init__()
        self.max_steps = 12
        self.lang_template = "make the row of {} in the pyramid with the {} blocks"
        self.task_completed_desc = "the pyramid stands."
        self.additional_reset()

    def reset(self, env):
        super().reset(env)
        side, pitch = 0.04, 0.05
        yaw = float(env.rng.uniform(-np.pi / 4, np.pi / 4))
        center = ((0.50, float(env.rng.uniform(-0.15, 0.15)), 0.001), utils.eulerXYZ_to_quatXYZW((0, 0, yaw)))
        mat = self.fill_template("zone/zone-template.urdf", {"DIM": (0.20, 0.10, 0.002), "COLOR": utils.COLORS["gray"]})
        env.add_object(mat, center, "fixed")

        rows = {3: "purple", 2: "cyan", 1: "orange"}
        blocks = {}
        for count, color in rows.items():
            blocks[count] = []
            for _ in range(count):
                pose = self.get_random_pose(env, (side, side, side))
                blocks[count].append(env.add_object(f"block/{color}_block.urdf", pose))

        for level, (count, color) in enumerate(rows.items()):
            offsets = [((index - (count - 1) / 2) * pitch, 0, side / 2 + level * side) for index in range(count)]
            self.add_goal(
                objs=blocks[count],
                matches=np.ones((count, count)),
                targ_poses=[utils.multiply(center, (offset, (0, 0, 0, 1))) for offset in offsets],
                replace=False,
                rotations=True,
                metric="pose",
                params=None,
                step_max_reward=count / 6,
                symmetries=[np.pi / 2] * count,
                language_goal=self.lang_template.format(count, color),
            )
