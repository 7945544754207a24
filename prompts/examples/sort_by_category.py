"""Sorting: groceries by kind onto two mats, one zone goal for each kind."""

import numpy as np

from grs_agents.sim import Task, utils


class SortCansAndBoxes(Task):
    """Put the cans on the left mat and the boxes on the right mat."""

    def __init__(self):
        super().__init__()
        self.max_steps = 10
        self.lang_template = "put the {} on the {} mat"
        self.task_completed_desc = "done sorting."
        self.additional_reset()

    def reset(self, env):
        super().reset(env)
        mat_size = (0.26, 0.26, 0.002)
        mats = {"left": ((0.52, 0.33, 0.001), (0, 0, 0, 1)), "right": ((0.52, -0.33, 0.001), (0, 0, 0, 1))}
        for side, color in (("left", "blue"), ("right", "green")):
            mat = self.fill_template("zone/zone-template.urdf", {"DIM": mat_size, "COLOR": utils.COLORS[color]})
            env.add_object(mat, mats[side], "fixed")

        cans = [
            env.add_object("HOPE/Corn.urdf", ((0.45, 0.05, 0.029), (0, 0, 0, 1))),
            env.add_object("HOPE/Tuna.urdf", ((0.60, -0.05, 0.017), (0, 0, 0, 1))),
        ]
        boxes = [
            env.add_object("HOPE/ChocolatePudding.urdf", ((0.40, -0.10, 0.025), (0, 0, 0, 1))),
            env.add_object("HOPE/CreamCheese.urdf", ((0.65, 0.10, 0.027), (0, 0, 0, 1))),
        ]
        for group, side, word in ((cans, "left", "cans"), (boxes, "right", "boxes")):
            self.add_goal(
                objs=group,
                matches=np.ones((len(group), 1)),
                targ_poses=[mats[side]],
                replace=True,
                rotations=False,
                metric="zone",
                params=[(mats[side], mat_size)],
                step_max_reward=0.5,
                language_goal=self.lang_template.format(word, side),
            )
