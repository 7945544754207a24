"""Alignment: turn boxes where they stand; only the yaw is wrong, so the target is the same place, turned."""

import numpy as np

from grs_agents.sim import Task, utils


class StraightenBoxes(Task):
    """Turn the three boxes where they stand until they point away from the robot."""

    def __init__(self):
        super().__init__()
        self.max_steps = 8
        self.lang_template = "turn the {} box so that it points straight ahead"
        self.task_completed_desc = "all boxes point ahead."
        self.additional_reset()

    def reset(self, env):
        super().reset(env)
        size = (0.12, 0.05, 0.05)
        places = {"red": 0.25, "green": 0.0, "blue": -0.25}
        for color, y in places.items():
            # At least 40 degrees off: rot_eps, 15 degrees, would accept less without any work.
            yaw = float(env.rng.choice([-1, 1]) * env.rng.uniform(np.pi * 2 / 9, np.pi / 2))
            place = (float(env.rng.uniform(0.42, 0.60)), y, size[2] / 2)
            box = self.fill_template("box/box-template.urdf", {"DIM": size, "COLOR": utils.COLORS[color]})
            obj = env.add_object(box, (place, utils.eulerXYZ_to_quatXYZW((0, 0, yaw))))
            self.add_goal(
                objs=[obj],
                matches=np.ones((1, 1)),
                targ_poses=[(place, (0, 0, 0, 1))],
                replace=False,
                rotations=True,
                metric="pose",
                params=None,
                step_max_reward=1 / len(places),
                symmetries=[np.pi],
                language_goal=self.lang_template.format(color),
            )
