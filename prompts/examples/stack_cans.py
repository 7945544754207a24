"""Stacking: real groceries on one another; heights come from the objects' sizes."""

import numpy as np

from grs_agents.sim import Task


class StackCans(Task):
    """Stack the cans on the can of corn, the flat ones on top."""

    def __init__(self):
        super().__init__()
        self.max_steps = 6
        self.lang_template = "put the can of {} on top of the stack"
        self.task_completed_desc = "the cans are stacked."
        self.additional_reset()

    def reset(self, env):
        super().reset(env)
        place = (float(env.rng.uniform(0.45, 0.60)), float(env.rng.uniform(-0.25, -0.10)))
        base = env.add_object("HOPE/Corn.urdf", ((*place, 0.029), (0, 0, 0, 1)))
        cans = [
            ("peaches", env.add_object("HOPE/Peaches.urdf", ((0.42, 0.20, 0.029), (0, 0, 0, 1)))),
            ("tuna", env.add_object("HOPE/Tuna.urdf", ((0.60, 0.12, 0.017), (0, 0, 0, 1)))),
            ("mushrooms", env.add_object("HOPE/Mushrooms.urdf", ((0.45, 0.36, 0.017), (0, 0, 0, 1)))),
        ]
        top = env.get_object_size(base)[2]
        for word, can in cans:
            height = env.get_object_size(can)[2]
            target = ((*place, top + height / 2), (0, 0, 0, 1))
            top += height
            # Round things look the same from every side: symmetry 0, any yaw will do.
            self.add_goal(
                objs=[can],
                matches=np.ones((1, 1)),
                targ_poses=[target],
                replace=False,
                rotations=False,
                metric="pose",
                params=None,
                step_max_reward=1 / len(cans),
                symmetries=[0],
                language_goal=self.lang_template.format(word),
            )
