"""Tidying: lay a place at the table; targets relative to a fixed plate."""

import numpy as np

from grs_agents.sim import Task


class SetTheTable(Task):
    """Put the bowl on the plate and the mug to the right of it."""

    def __init__(self):
        super().__init__()
        self.max_steps = 5
        self.lang_template = "put the {} {} the plate"
        self.task_completed_desc = "the table is set."
        self.additional_reset()

    def reset(self, env):
        super().reset(env)
        sizes = {word: env.library.asset(f"{word}/{word}.urdf").size for word in ("plate", "bowl", "mug")}
        x, y, top = 0.50, float(env.rng.uniform(-0.05, 0.10)), sizes["plate"][2]
        env.add_object("plate/plate.urdf", ((x, y, top / 2), (0, 0, 0, 1)), "fixed")

        bowl = env.add_object("bowl/bowl.urdf", ((0.45, 0.36, sizes["bowl"][2] / 2), (0, 0, 0, 1)))
        mug = env.add_object("mug/mug.urdf", ((0.40, -0.36, sizes["mug"][2] / 2), (0, 0, 0, 1)))
        goals = [
            (bowl, (x, y, top + sizes["bowl"][2] / 2), "bowl", "on"),
            (mug, (x, y - 0.20, sizes["mug"][2] / 2), "mug", "to the right of"),
        ]
        for obj, place, word, where in goals:
            self.add_goal(
                objs=[obj],
                matches=np.ones((1, 1)),
                targ_poses=[(place, (0, 0, 0, 1))],
                replace=False,
                rotations=False,
                metric="pose",
                params=None,
                step_max_reward=1 / len(goals),
                symmetries=[0],
                language_goal=self.lang_template.format(word, where),
            )
