"""Clearing: take things out of a container; they start inside it and a zone is their goal."""

import numpy as np

from grs_agents.sim import Task, utils


class UnpackContainer(Task):
    """Take everything out of the box and put it on the mat."""

    def __init__(self):
        super().__init__()
        self.max_steps = 8
        self.lang_template = "empty the box onto the mat"
        self.task_completed_desc = "the box is empty."
        self.additional_reset()

    def reset(self, env):
        super().reset(env)
        box_size, floor, side = (0.24, 0.18, 0.05), 0.005, float(env.rng.choice([-1, 1]))
        x, y = 0.48, side * 0.20
        box = self.fill_template("container/container-template.urdf", {"DIM": box_size, "COLOR": utils.COLORS["brown"]})
        env.add_object(box, ((x, y, box_size[2] / 2), (0, 0, 0, 1)), "fixed")
        mat_size, mat_pose = (0.26, 0.20, 0.002), ((0.50, -side * 0.20, 0.001), (0, 0, 0, 1))
        mat = self.fill_template("zone/zone-template.urdf", {"DIM": mat_size, "COLOR": utils.COLORS["yellow"]})
        env.add_object(mat, mat_pose, "fixed")

        # They stand on the floor of the box, 5 mm thick, well clear of each other.
        things = []
        for index, color in enumerate(env.rng.permutation(["red", "green", "blue", "purple"])):
            dim = (0.05, 0.05, float(env.rng.uniform(0.04, 0.08)))
            place = (x + (0.05 if index % 2 else -0.05), y + (0.04 if index < 2 else -0.04), floor + dim[2] / 2)
            template = "cylinder/cylinder-template.urdf" if index % 2 else "box/box-template.urdf"
            thing = self.fill_template(template, {"DIM": dim, "COLOR": utils.COLORS[color]})
            things.append(env.add_object(thing, (place, (0, 0, 0, 1))))

        self.add_goal(
            objs=things,
            matches=np.ones((len(things), 1)),
            targ_poses=[mat_pose],
            replace=True,
            rotations=False,
            metric="zone",
            params=[(mat_pose, mat_size)],
            step_max_reward=1.0,
            language_goal=self.lang_template,
        )
