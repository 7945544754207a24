"""Placing: relative to something, on the side that the words name; y points left, x away from the robot."""

import numpy as np

from grs_agents.sim import Task


class PlaceBesideMilk(Task):
    """Put the two cans beside the carton, each on the side that is asked for."""

    def __init__(self):
        super().__init__()
        self.max_steps = 5
        self.lang_template = "put the can of {} {} the milk"
        self.task_completed_desc = "done placing."
        self.additional_reset()

    def reset(self, env):
        super().reset(env)
        x, y = 0.50, 0.0
        env.add_object("HOPE/Milk.urdf", ((x, y, 0.095), (0, 0, 0, 1)))
        cans = [
            ("corn", env.add_object("HOPE/Corn.urdf", ((0.42, 0.34, 0.029), (0, 0, 0, 1)))),
            ("tomato sauce", env.add_object("HOPE/TomatoSauce.urdf", ((0.45, -0.33, 0.042), (0, 0, 0, 1)))),
        ]
        distance = 0.13
        sides = {
            "to the left of": (x, y + distance),
            "to the right of": (x, y - distance),
            "behind": (x + distance, y),
            "in front of": (x - distance, y),
        }
        chosen = env.rng.permutation(list(sides))[: len(cans)]
        for (word, can), side in zip(cans, chosen, strict=True):
            height = env.get_object_size(can)[2]
            self.add_goal(
                objs=[can],
                matches=np.ones((1, 1)),
                targ_poses=[((*sides[side], height / 2), (0, 0, 0, 1))],
                replace=False,
                rotations=False,
                metric="pose",
                params=None,
                step_max_reward=1 / len(cans),
                symmetries=[0],
                language_goal=self.lang_template.format(word, side),
            )
