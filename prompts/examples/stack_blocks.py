"""Stacking: blocks on one that stays where it is, one goal for each level."""

import numpy as np

from grs_agents.sim import Task


class StackThreeBlocks(Task):
    """Stack the green block and then the red block on the blue block."""

    def __init__(self):
        super().__init__()
        self.max_steps = 6
        self.lang_template = "put the {} block on top"
        self.task_completed_desc = "done stacking."
        self.additional_reset()

    def reset(self, env):
        super().reset(env)
        side = 0.04
        base_pose = ((0.50, 0.10, side / 2), (0, 0, 0, 1))
        env.add_object("block/blue_block.urdf", base_pose)

        blocks = []
        for color in ("green", "red"):
            pose = self.get_random_pose(env, (side, side, side))
            blocks.append(env.add_object(f"block/{color}_block.urdf", pose))

        # One goal for each block, from the bottom up: the target is the centre of the block when it is in place.
        for level, (block, color) in enumerate(zip(blocks, ("green", "red"), strict=True), start=1):
            target = ((0.50, 0.10, side / 2 + level * side), (0, 0, 0, 1))
            self.add_goal(
                objs=[block],
                matches=np.ones((1, 1)),
                targ_poses=[target],
                replace=False,
                rotations=True,
                metric="pose",
                params=None,
                step_max_reward=1 / len(blocks),
                symmetries=[np.pi / 2],
                language_goal=self.lang_template.format(color),
            )
