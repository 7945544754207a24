"""Piles: two piles are pushed apart, each into the zone of its colour, one goal for each."""

import numpy as np

from grs_agents.sim import Task, utils


class SeparateRedAndBlue(Task):
    """Push the red pile and the blue pile apart, each into the square of its colour."""

    def __init__(self):
        super().__init__()
        self.max_steps = 20
        self.primitive = "push"
        self.lang_template = "push the piles apart: the {0} blocks into the {0} square"
        self.task_completed_desc = "the piles are apart."
        self.additional_reset()

    def reset(self, env):
        super().reset(env)
        size = (0.15, 0.15, 0.002)
        piles = []
        for color, middle, aside in (("red", -0.04, -0.25), ("blue", 0.06, 0.27)):
            square_pose = ((0.5, aside, 0.001), (0, 0, 0, 1))
            square = self.fill_template("zone/zone-template.urdf", {"DIM": size, "COLOR": utils.COLORS[color]})
            env.add_object(square, square_pose, "fixed")
            # Five rows of three blocks of 1 cm, each somewhere in its own 2 cm, so that none starts inside another.
            blocks = []
            for row, column in np.ndindex(5, 3):
                x, y = 0.44 + 0.02 * row, middle + 0.02 * column
                x, y = x + env.rng.uniform(-0.003, 0.003), y + env.rng.uniform(-0.003, 0.003)
                turn = utils.eulerXYZ_to_quatXYZW((0, 0, env.rng.uniform(-np.pi, np.pi)))
                blocks.append(env.add_object("block/small.urdf", ((x, y, 0.005), turn), color=color))
            piles.append((color, blocks, square_pose))

        for color, blocks, square_pose in piles:
            self.add_goal(
                objs=blocks,
                matches=np.ones((len(blocks), 1)),
                targ_poses=[square_pose],
                replace=True,
                rotations=False,
                metric="zone",
                params=[(square_pose, size)],
                step_max_reward=1 / 2,
                language_goal=self.lang_template.format(color),
            )
