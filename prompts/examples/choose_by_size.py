"""Choosing: the largest and the smallest of a row; what the words mean is computed from get_object_size."""

import numpy as np

from grs_agents.sim import Task, utils


class ChooseBySize(Task):
    """Put the largest box into the red zone and the smallest into the blue zone, and leave the rest."""

    def __init__(self):
        super().__init__()
        self.max_steps = 5
        self.lang_template = "put the {} box into the {} zone"
        self.task_completed_desc = "done choosing."
        self.additional_reset()

    def reset(self, env):
        super().reset(env)
        zone_size = (0.12, 0.12, 0.002)
        zones = {}
        for color in ("red", "blue"):
            zones[color] = self.get_random_pose(env, zone_size)
            zone = self.fill_template("zone/zone-template.urdf", {"DIM": zone_size, "COLOR": utils.COLORS[color]})
            env.add_object(zone, zones[color], "fixed")

        boxes = []
        for side in env.rng.permutation([0.03, 0.045, 0.06, 0.075]):
            dim = (float(side), float(side), 0.05)
            box = self.fill_template("box/box-template.urdf", {"DIM": dim, "COLOR": utils.COLORS["gold"]})
            boxes.append(env.add_object(box, self.get_random_pose(env, dim)))
        boxes.sort(key=lambda box: float(np.prod(env.get_object_size(box))))

        for box, word, color in ((boxes[-1], "largest", "red"), (boxes[0], "smallest", "blue")):
            self.add_goal(
                objs=[box],
                matches=np.ones((1, 1)),
                targ_poses=[zones[color]],
                replace=False,
                rotations=False,
                metric="zone",
                params=[(zones[color], zone_size)],
                step_max_reward=0.5,
                language_goal=self.lang_template.format(word, color),
            )
