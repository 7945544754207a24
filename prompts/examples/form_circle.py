"""Pattern: a circle around something; targets from sine and cosine, any object may take any of them."""

import numpy as np

from grs_agents.sim import Task, utils


class FormCircle(Task):
    """Set the six cylinders in a circle around the plate."""

    def __init__(self):
        super().__init__()
        self.max_steps = 12
        self.lang_template = "make a circle of cylinders around the plate"
        self.task_completed_desc = "the circle is closed."
        self.additional_reset()

    def reset(self, env):
        super().reset(env)
        count, radius = 6, 0.16
        x, y = 0.50, float(env.rng.uniform(-0.15, 0.15))
        plate_size = env.library.asset("plate/plate.urdf").size
        mat = self.fill_template(
            "zone/zone-template.urdf", {"DIM": (0.38, 0.38, 0.001), "COLOR": utils.COLORS["white"]}
        )
        env.add_object(mat, ((x, y, 0.0005), (0, 0, 0, 1)), "fixed")
        env.add_object("plate/plate.urdf", ((x, y, plate_size[2] / 2), (0, 0, 0, 1)), "fixed")

        # Any cylinder may take any place, so all are of one height, and so are the targets.
        height = float(env.rng.uniform(0.03, 0.07))
        dim = (0.04, 0.04, height)
        cylinders = []
        for color in ("red", "orange", "yellow", "green", "blue", "purple"):
            cylinder = self.fill_template("cylinder/cylinder-template.urdf", {"DIM": dim, "COLOR": utils.COLORS[color]})
            cylinders.append(env.add_object(cylinder, self.get_random_pose(env, dim)))

        angles = np.arange(count) * 2 * np.pi / count
        targets = [((x + radius * np.cos(a), y + radius * np.sin(a), height / 2), (0, 0, 0, 1)) for a in angles]
        self.add_goal(
            objs=cylinders,
            matches=np.ones((count, count)),
            targ_poses=targets,
            replace=False,
            rotations=False,
            metric="pose",
            params=None,
            step_max_reward=1.0,
            symmetries=[0] * count,
            language_goal=self.lang_template,
        )
