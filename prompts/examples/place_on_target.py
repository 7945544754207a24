"""Placing: on something and behind it; a target's height is that of the thing's centre."""

import numpy as np

from grs_agents.sim import Task


class PutMustardOnPlate(Task):
    """Put the can on the plate and the bottle behind it."""

    def __init__(self):
        super().__init__()
        self.max_steps = 5
        self.lang_template = "put the {} {}"
        self.task_completed_desc = "the table is laid."
        self.additional_reset()

    def reset(self, env):
        super().reset(env)
        plate_size = env.library.asset("plate/plate.urdf").size
        plate_pose = ((0.45, -0.20, plate_size[2] / 2), (0, 0, 0, 1))
        env.add_object("plate/plate.urdf", plate_pose, "fixed")

        can = env.add_object("HOPE/Peaches.urdf", ((0.50, 0.25, 0.029), (0, 0, 0, 1)))
        bottle = env.add_object("HOPE/Mustard.urdf", ((0.40, 0.10, 0.080), (0, 0, 0, 1)))

        goals = [
            (can, ((0.45, -0.20, plate_size[2] + 0.029), (0, 0, 0, 1)), "can", "on the plate"),
            (bottle, ((0.66, -0.20, 0.080), (0, 0, 0, 1)), "bottle", "behind the plate"),
        ]
        for obj, target, word, where in goals:
            self.add_goal(
                objs=[obj],
                matches=np.ones((1, 1)),
                targ_poses=[target],
                replace=False,
                rotations=False,
                metric="pose",
                params=None,
                step_max_reward=1 / len(goals),
                symmetries=[0],
                language_goal=self.lang_template.format(word, where),
            )
