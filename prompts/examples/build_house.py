"""Building: a house of parts of different sizes, from the ground up; a table of parts makes objects and goals."""

import numpy as np

from grs_agents.sim import Task, utils


class BuildHouse(Task):
    """Build a house: two walls, a ceiling across them, and a chimney on top."""

    def __init__(self):
        super().__init__()
        self.max_steps = 9
        self.lang_template = "build the house: now the {}"
        self.task_completed_desc = "the house is built."
        self.additional_reset()

    def reset(self, env):
        super().reset(env)
        x, y = float(env.rng.uniform(0.45, 0.55)), float(env.rng.uniform(-0.15, 0.15))
        plot = self.fill_template("zone/zone-template.urdf", {"DIM": (0.2, 0.2, 0.002), "COLOR": utils.COLORS["green"]})
        env.add_object(plot, ((x, y, 0.001), (0, 0, 0, 1)), "fixed")

        # (name, size, colour, centre relative to the plot, symmetry), each part rests on those before it.
        parts = [
            ("left wall", (0.14, 0.04, 0.06), "red", (0, 0.05, 0.03), np.pi),
            ("right wall", (0.14, 0.04, 0.06), "red", (0, -0.05, 0.03), np.pi),
            ("ceiling", (0.16, 0.16, 0.02), "brown", (0, 0, 0.07), np.pi / 2),
            ("chimney", (0.04, 0.04, 0.05), "gray", (0.03, 0.03, 0.105), np.pi / 2),
        ]
        for name, size, color, (dx, dy, z), symmetry in parts:
            part = self.fill_template("box/box-template.urdf", {"DIM": size, "COLOR": utils.COLORS[color]})
            self.add_goal(
                objs=[env.add_object(part, self.get_random_pose(env, size))],
                matches=np.ones((1, 1)),
                targ_poses=[((x + dx, y + dy, z), (0, 0, 0, 1))],
                replace=False,
                rotations=True,
                metric="pose",
                params=None,
                step_max_reward=1 / len(parts),
                symmetries=[symmetry],
                language_goal=self.lang_template.format(name),
            )
