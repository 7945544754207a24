"""Piles: a pile of grains is swept into a zone; `primitive` makes pushing with a spatula the way to act."""

import numpy as np

from grs_agents.sim import Task, utils


class SweepCrumbs(Task):
    """Sweep the pile of crumbs into the green square."""

    def __init__(self):
        super().__init__()
        self.max_steps = 20
        self.primitive = "push"
        self.lang_template = "push the piles of {} crumbs into the green square"
        self.task_completed_desc = "done sweeping."
        self.num_blocks = 30
        self.additional_reset()

    def reset(self, env):
        super().reset(env)
        # The square is on the left, away from the patch in the middle of the table where the pile lies.
        square_pose = ((0.5, 0.28, 0.001), (0, 0, 0, 1))
        square_size = (0.14, 0.14, 0.002)
        square = self.fill_template("zone/zone-template.urdf", {"DIM": square_size, "COLOR": utils.COLORS["green"]})
        env.add_object(square, square_pose, "fixed")
        crumbs = self.make_piles(env, block_color="brown")

        self.add_goal(
            objs=crumbs,
            matches=np.ones((len(crumbs), 1)),
            targ_poses=[square_pose],
            replace=True,
            rotations=False,
            metric="zone",
            params=[(square_pose, square_size)],
            step_max_reward=1.0,
            language_goal=self.lang_template.format("brown"),
        )
