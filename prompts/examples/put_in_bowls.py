"""Bowls: one goal for all blocks, matches say that any of them may go into any bowl."""

import numpy as np

from grs_agents.sim import Task


class PutBlocksInBowls(Task):
    """Put one block into each bowl; any block may go into any bowl."""

    def __init__(self):
        super().__init__()
        self.max_steps = 6
        self.pos_eps = 0.05
        self.lang_template = "put a block into each bowl"
        self.task_completed_desc = "done filling the bowls."
        self.additional_reset()

    def reset(self, env):
        super().reset(env)
        bowl_size = env.library.asset("bowl/bowl.urdf").size
        bowl_poses = [((0.45, y, bowl_size[2] / 2), (0, 0, 0, 1)) for y in (-0.25, 0.25)]
        for pose in bowl_poses:
            env.add_object("bowl/bowl.urdf", pose, "fixed")

        blocks = []
        for color in ("red", "yellow"):
            pose = self.get_random_pose(env, (0.04, 0.04, 0.04))
            blocks.append(env.add_object(f"block/{color}_block.urdf", pose))

        # replace=False: each bowl takes one block; matches of ones: either block will do.
        self.add_goal(
            objs=blocks,
            matches=np.ones((len(blocks), len(bowl_poses))),
            targ_poses=bowl_poses,
            replace=False,
            rotations=False,
            metric="pose",
            params=None,
            step_max_reward=1.0,
            symmetries=[0] * len(blocks),
            language_goal=self.lang_template,
        )
