"""Stacking: a typed goal, stacked(objects) from the bottom up; the order comes from the objects' own sizes."""

import numpy as np

from grs_agents.sim import Task, stacked, utils


class StackBySize(Task):
    """Stack the four slabs, the widest at the bottom."""

    def __init__(self):
        super().__init__()
        self.max_steps = 8
        self.lang_template = "stack the slabs by size, the widest at the bottom"
        self.task_completed_desc = "the slabs are stacked."
        self.additional_reset()

    def reset(self, env):
        super().reset(env)
        slabs = []
        colors = env.rng.permutation(["red", "orange", "yellow", "green", "blue"])
        for width, color in zip((0.06, 0.08, 0.10, 0.12), colors, strict=False):
            dim = (width, width, float(env.rng.uniform(0.02, 0.04)))
            slab = self.fill_template("box/box-template.urdf", {"DIM": dim, "COLOR": utils.COLORS[color]})
            slabs.append(env.add_object(slab, self.get_random_pose(env, dim)))
        slabs.sort(key=lambda slab: float(np.prod(env.get_object_size(slab)[:2])), reverse=True)

        # Nothing says where: the widest slab may stay where it is.
        self.add_goal(stacked(slabs), step_max_reward=1.0, language_goal=self.lang_template)
