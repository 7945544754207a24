"""Alignment: in a row, in an order that is computed from the objects' sizes."""

import numpy as np

from grs_agents.sim import Task


class LineUpByHeight(Task):
    """Line the items up from left to right, the tallest first."""

    def __init__(self):
        super().__init__()
        self.max_steps = 8
        self.lang_template = "line the items up by height, the tallest on the left"
        self.task_completed_desc = "done lining up."
        self.additional_reset()

    def reset(self, env):
        super().reset(env)
        items = [
            ("HOPE/Yogurt.urdf", ((0.40, 0.25, 0.027), (0, 0, 0, 1))),
            ("HOPE/Milk.urdf", ((0.42, -0.30, 0.095), (0, 0, 0, 1))),
            ("HOPE/TomatoSauce.urdf", ((0.40, 0.00, 0.042), (0, 0, 0, 1))),
        ]
        objects = [env.add_object(urdf, pose) for urdf, pose in items]
        objects.sort(key=lambda obj: -env.get_object_size(obj)[2])

        # y points to the left, so the line starts at the largest y; 12 cm apart leaves room between them.
        for index, obj in enumerate(objects):
            height = env.get_object_size(obj)[2]
            target = ((0.62, 0.12 - 0.12 * index, height / 2), (0, 0, 0, 1))
            self.add_goal(
                objs=[obj],
                matches=np.ones((1, 1)),
                targ_poses=[target],
                replace=False,
                rotations=False,
                metric="pose",
                params=None,
                step_max_reward=1 / len(objects),
                symmetries=[0],
                language_goal=self.lang_template,
            )
