"""Clearing: an area of the table; one zone is the goal of everything that stands there."""

import numpy as np

from grs_agents.sim import Task, utils


class ClearTheMiddle(Task):
    """Clear the middle of the table: move everything there to the free strip on the left."""

    def __init__(self):
        super().__init__()
        self.max_steps = 8
        self.lang_template = "clear the middle of the table"
        self.task_completed_desc = "the middle is clear."
        self.additional_reset()

    def reset(self, env):
        super().reset(env)
        objects = [
            env.add_object("HOPE/Raisins.urdf", ((0.46, -0.04, 0.062), (0, 0, 0, 1))),
            env.add_object("HOPE/AlphabetSoup.urdf", ((0.58, 0.03, 0.042), (0, 0, 0, 1))),
            env.add_object("HOPE/Popcorn.urdf", ((0.52, 0.13, 0.043), (0, 0, 0, 1))),
        ]
        # The strip lies within reach (0.85 m from the base) and is large enough for all three.
        strip_pose = ((0.48, 0.36, 0.001), (0, 0, 0, 1))
        strip_size = (0.44, 0.20, 0.002)
        strip = self.fill_template("zone/zone-template.urdf", {"DIM": strip_size, "COLOR": utils.COLORS["yellow"]})
        env.add_object(strip, strip_pose, "fixed")

        self.add_goal(
            objs=objects,
            matches=np.ones((len(objects), 1)),
            targ_poses=[strip_pose],
            replace=True,
            rotations=False,
            metric="zone",
            params=[(strip_pose, strip_size)],
            step_max_reward=1.0,
            language_goal=self.lang_template,
        )
