"""Insertion: a block shaped like an L into the fixture that fits it; no symmetry, so 2 pi."""

import numpy as np

from grs_agents.sim import Task, utils


class InsertElls(Task):
    """Insert the red and the blue L-shaped block into a fixture each."""

    def __init__(self):
        super().__init__()
        self.max_steps = 5
        self.lang_template = "put the L shaped blocks into the fixtures"
        self.task_completed_desc = "done with insertion."
        self.additional_reset()

    def reset(self, env):
        super().reset(env)
        # The origin of both is the corner of the L, not its middle: a larger square is kept free around it.
        room = (0.18, 0.18, 0.04)
        fixtures = []
        for _ in range(2):
            fixtures.append(self.get_random_pose(env, room))
            env.add_object("insertion/fixture.urdf", fixtures[-1], "fixed")
        ells = [
            env.add_object("insertion/ell.urdf", self.get_random_pose(env, room), color=utils.COLORS[color])
            for color in ("red", "blue")
        ]

        # Either block fits either fixture, in one way only.
        self.add_goal(
            objs=ells,
            matches=np.ones((2, 2)),
            targ_poses=fixtures,
            replace=False,
            rotations=True,
            metric="pose",
            params=None,
            step_max_reward=1.0,
            symmetries=[2 * np.pi] * 2,
            language_goal=self.lang_template,
        )
