"""Bowls: each block into the bowl of its colour; pos_eps of 5 cm lets it lie anywhere in it."""

import numpy as np

from grs_agents.sim import Task, utils


class BlocksInMatchingBowls(Task):
    """Put each block into the bowl of the same colour."""

    def __init__(self):
        super().__init__()
        self.max_steps = 6
        self.pos_eps = 0.05
        self.lang_template = "put each block into the bowl of its colour"
        self.task_completed_desc = "every block is in its bowl."
        self.additional_reset()

    def reset(self, env):
        super().reset(env)
        colors = env.rng.permutation(["red", "green", "blue", "yellow"])[:3]
        bowl_size = env.library.asset("bowl/bowl.urdf").size
        bowl_poses = []
        for color in colors:
            pose = self.get_random_pose(env, bowl_size)
            env.add_object("bowl/bowl.urdf", pose, "fixed", color=utils.COLORS[color])
            bowl_poses.append(pose)

        blocks = []
        for color in colors:
            pose = self.get_random_pose(env, (0.04, 0.04, 0.04))
            blocks.append(env.add_object("block/block.urdf", pose, color=utils.COLORS[color]))

        # The identity matrix: the first block goes into the first bowl, and so on.
        self.add_goal(
            objs=blocks,
            matches=np.eye(len(blocks)),
            targ_poses=bowl_poses,
            replace=False,
            rotations=False,
            metric="pose",
            params=None,
            step_max_reward=1.0,
            symmetries=[0] * len(blocks),
            language_goal=self.lang_template,
        )
