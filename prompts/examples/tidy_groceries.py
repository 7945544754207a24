"""Tidying: groceries stand where the photo shows them; two goals after each other, a zone and a container."""

import numpy as np

from grs_agents.sim import Task, utils


class TidyGroceries(Task):
    """Put the small things into the basket, then stand the tall ones on the mat."""

    def __init__(self):
        super().__init__()
        self.max_steps = 10
        self.lang_template = "put {}"
        self.task_completed_desc = "the table is tidy."
        self.additional_reset()

    def reset(self, env):
        super().reset(env)
        # Only where the basket and the mat lie is free: left or right. The photo fixes the rest.
        side = float(env.rng.choice([-1, 1]))
        basket_size, mat_size = (0.28, 0.22, 0.07), (0.26, 0.18, 0.002)
        basket_pose = ((0.48, side * 0.33, basket_size[2] / 2), (0, 0, 0, 1))
        mat_pose = ((0.48, -side * 0.33, 0.001), (0, 0, 0, 1))
        values = {"DIM": basket_size, "COLOR": utils.COLORS["brown"]}
        env.add_object(self.fill_template("container/container-template.urdf", values), basket_pose, "fixed")
        values = {"DIM": mat_size, "COLOR": utils.COLORS["cyan"]}
        env.add_object(self.fill_template("zone/zone-template.urdf", values), mat_pose, "fixed")

        small = [
            env.add_object("HOPE/Tuna.urdf", ((0.42, 0.08, 0.017), (0, 0, 0.2, 0.98))),
            env.add_object("HOPE/Butter.urdf", ((0.56, 0.10, 0.027), (0, 0, 0.5, 0.866))),
            env.add_object("HOPE/Pineapple.urdf", ((0.63, -0.04, 0.029), (0, 0, 0, 1))),
        ]
        tall = [
            env.add_object("HOPE/Milk.urdf", ((0.40, -0.08, 0.095), (0, 0, 0, 1))),
            env.add_object("HOPE/Raisins.urdf", ((0.53, -0.11, 0.062), (0, 0, 0, 1))),
        ]
        for group, pose, size, words in (
            (small, basket_pose, basket_size, "the small things into the basket"),
            (tall, mat_pose, mat_size, "the tall things on the mat"),
        ):
            self.add_goal(
                objs=group,
                matches=np.ones((len(group), 1)),
                targ_poses=[pose],
                replace=True,
                rotations=False,
                metric="zone",
                params=[(pose, size)],
                step_max_reward=len(group) / 5,
                language_goal=self.lang_template.format(words),
            )
