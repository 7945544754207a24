"""Packing: a pair of things into each of several containers; replace=True lets them share a target."""

import numpy as np

from grs_agents.sim import Task, utils


class PackPairs(Task):
    """Put a block and a cylinder of the same colour into the container of that colour."""

    def __init__(self):
        super().__init__()
        self.max_steps = 12
        self.lang_template = "put the {0} block and the {0} cylinder into the {0} container"
        self.task_completed_desc = "every pair is packed."
        self.additional_reset()

    def reset(self, env):
        super().reset(env)
        size = (0.16, 0.11, 0.05)
        colors = [str(color) for color in env.rng.permutation(["red", "green", "blue"])]
        poses = {color: ((0.60, y, size[2] / 2), (0, 0, 0, 1)) for color, y in zip(colors, (-0.2, 0, 0.2), strict=True)}
        for color, pose in poses.items():
            values = {"DIM": size, "COLOR": utils.COLORS[color]}
            env.add_object(self.fill_template("container/container-template.urdf", values), pose, "fixed")

        dim = (0.04, 0.04, 0.05)
        for color, target in poses.items():
            cylinder = self.fill_template("cylinder/cylinder-template.urdf", {"DIM": dim, "COLOR": utils.COLORS[color]})
            pair = [
                env.add_object("block/block.urdf", self.get_random_pose(env, dim), color=color),
                env.add_object(cylinder, self.get_random_pose(env, dim)),
            ]
            self.add_goal(
                objs=pair,
                matches=np.ones((2, 1)),
                targ_poses=[target],
                replace=True,
                rotations=False,
                metric="zone",
                params=[(target, size)],
                step_max_reward=1 / len(poses),
                language_goal=self.lang_template.format(color),
            )
