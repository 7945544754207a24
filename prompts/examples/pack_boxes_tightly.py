"""Packing: boxes of random sizes that fill a container; the sizes are made by cutting its floor up."""

import numpy as np

from grs_agents.sim import Task, utils


class PackBoxesTightly(Task):
    """Pack the boxes, which just fit, into the brown container."""

    def __init__(self):
        super().__init__()
        self.max_steps = 10
        self.lang_template = "pack all the boxes into the brown container"
        self.task_completed_desc = "done packing."
        self.additional_reset()

    def reset(self, env):
        super().reset(env)
        size = np.array([0.24, 0.20, 0.05])
        pose = ((0.52, float(env.rng.uniform(-0.05, 0.05)), size[2] / 2), (0, 0, 0, 1))
        container = self.fill_template(
            "container/container-template.urdf", {"DIM": size, "COLOR": utils.COLORS["brown"]}
        )
        env.add_object(container, pose, "fixed")

        # Cut the floor across and both parts along; walls are 5 mm thick, and a margin lets the boxes in.
        inner, margin = size[:2] - 0.01, 0.02
        cut = env.rng.uniform(0.4, 0.6) * inner[0]
        boxes = []
        for width in (cut, inner[0] - cut):
            split = env.rng.uniform(0.35, 0.65) * inner[1]
            for depth in (split, inner[1] - split):
                dim = (width - margin, depth - margin, float(env.rng.uniform(0.04, 0.07)))
                color = utils.COLORS[env.rng.choice(["red", "green", "blue", "yellow", "purple", "orange"])]
                box = self.fill_template("box/box-template.urdf", {"DIM": dim, "COLOR": color})
                boxes.append(env.add_object(box, self.get_random_pose(env, dim)))

        self.add_goal(
            objs=boxes,
            matches=np.ones((len(boxes), 1)),
            targ_poses=[pose],
            replace=True,
            rotations=False,
            metric="zone",
            params=[(pose, size)],
            step_max_reward=1.0,
            language_goal=self.lang_template,
        )
