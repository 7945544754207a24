"""Sorting: by size, small and large cylinders into two open boxes; the reward of a goal is its share of objects."""

import numpy as np

from grs_agents.sim import Task, utils


class SortCylindersIntoBoxes(Task):
    """Put the thin cylinders into the blue box and the thick ones into the orange box."""

    def __init__(self):
        super().__init__()
        self.max_steps = 10
        self.lang_template = "put the {} cylinders into the {} box"
        self.task_completed_desc = "done sorting."
        self.additional_reset()

    def reset(self, env):
        super().reset(env)
        box_size = (0.20, 0.20, 0.05)
        side = float(env.rng.choice([-1, 1]))
        kinds = {"thin": ("blue", 0.03, 3, side * 0.30), "thick": ("orange", 0.055, 2, -side * 0.30)}
        boxes = {}
        for word, (color, _, _, y) in kinds.items():
            boxes[word] = ((0.50, y, box_size[2] / 2), (0, 0, 0, 1))
            values = {"DIM": box_size, "COLOR": utils.COLORS[color]}
            env.add_object(self.fill_template("container/container-template.urdf", values), boxes[word], "fixed")

        for word, (color, width, count, _) in kinds.items():
            cylinders = []
            for _ in range(count):
                dim = (width, width, float(env.rng.uniform(0.04, 0.07)))
                cylinder = self.fill_template("cylinder/cylinder-template.urdf", {"DIM": dim, "COLOR": (0.7, 0.7, 0.7)})
                cylinders.append(env.add_object(cylinder, self.get_random_pose(env, dim)))
            self.add_goal(
                objs=cylinders,
                matches=np.ones((count, 1)),
                targ_poses=[boxes[word]],
                replace=True,
                rotations=False,
                metric="zone",
                params=[(boxes[word], box_size)],
                step_max_reward=count / 5,
                language_goal=self.lang_template.format(word, color),
            )
