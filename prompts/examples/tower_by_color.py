"""Stacking: a tower on a stand that lies anywhere; targets in the stand's frame, one goal for each level."""

import numpy as np

from grs_agents.sim import Task, utils


class TowerByColor(Task):
    """Stack four blocks on the stand in the order of colours that is asked for."""

    def __init__(self):
        super().__init__()
        self.max_steps = 8
        self.lang_template = "put the {} block on the {}"
        self.task_completed_desc = "done building the tower."
        self.additional_reset()

    def reset(self, env):
        super().reset(env)
        side = 0.04
        stand_size = (0.08, 0.08, 0.01)
        stand_pose = self.get_random_pose(env, stand_size)
        stand = self.fill_template("box/box-template.urdf", {"DIM": stand_size, "COLOR": utils.COLORS["gray"]})
        env.add_object(stand, stand_pose, "fixed")

        colors = env.rng.permutation(["red", "green", "blue", "yellow"])
        blocks = [
            env.add_object("block/block.urdf", self.get_random_pose(env, (side, side, side)), color=color)
            for color in colors
        ]
        # The stand's pose is that of its centre: levels are counted from there, turned as the stand is.
        below = "stand"
        for level, (block, color) in enumerate(zip(blocks, colors, strict=True)):
            offset = (0, 0, stand_size[2] / 2 + side / 2 + level * side)
            self.add_goal(
                objs=[block],
                matches=np.ones((1, 1)),
                targ_poses=[utils.multiply(stand_pose, (offset, (0, 0, 0, 1)))],
                replace=False,
                rotations=True,
                metric="pose",
                params=None,
                step_max_reward=1 / len(blocks),
                symmetries=[np.pi / 2],
                language_goal=self.lang_template.format(color, below),
            )
            below = f"{color} block"
