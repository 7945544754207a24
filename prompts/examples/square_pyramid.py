"""Pyramid: in three dimensions, four blocks in a square and one on their middle."""

import numpy as np

from grs_agents.sim import Task, utils


class SquarePyramid(Task):
    """Set four blocks in a square and put the fifth on the middle of them."""

    def __init__(self):
        super().__init__()
        self.max_steps = 10
        self.lang_template = "build a square pyramid: {}"
        self.task_completed_desc = "the pyramid stands."
        self.additional_reset()

    def reset(self, env):
        super().reset(env)
        side, half = 0.04, 0.025
        mat_size = (0.16, 0.16, 0.002)
        center = ((float(env.rng.uniform(0.42, 0.55)), 0.15, 0.001), (0, 0, 0, 1))
        mat = self.fill_template("zone/zone-template.urdf", {"DIM": mat_size, "COLOR": utils.COLORS["yellow"]})
        env.add_object(mat, center, "fixed")

        base = []
        for _ in range(4):
            pose = self.get_random_pose(env, (side, side, side))
            base.append(env.add_object("block/green_block.urdf", pose))
        top = env.add_object("block/red_block.urdf", self.get_random_pose(env, (side, side, side)))

        x, y = center[0][:2]
        corners = [((x + dx, y + dy, side / 2), (0, 0, 0, 1)) for dx in (-half, half) for dy in (-half, half)]
        tip = ((x, y, 1.5 * side), (0, 0, 0, 1))
        for blocks, targets, words in ((base, corners, "the green base"), ([top], [tip], "the red tip")):
            self.add_goal(
                objs=blocks,
                matches=np.ones((len(blocks), len(targets))),
                targ_poses=targets,
                replace=False,
                rotations=True,
                metric="pose",
                params=None,
                step_max_reward=len(blocks) / 5,
                symmetries=[np.pi / 2] * len(blocks),
                language_goal=self.lang_template.format(words),
            )
