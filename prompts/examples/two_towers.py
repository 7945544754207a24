"""Stacking: two towers grow together; a goal for each level, matches say which blocks may go to which tower."""

import numpy as np

from grs_agents.sim import Task, utils


class TwoTowers(Task):
    """Build a tower of red blocks on the red mat and one of blue blocks on the blue mat."""

    def __init__(self):
        super().__init__()
        self.max_steps = 12
        self.lang_template = "build a red and a blue tower: level {}"
        self.task_completed_desc = "both towers stand."
        self.additional_reset()

    def reset(self, env):
        super().reset(env)
        side, levels = 0.04, 3
        y = float(env.rng.uniform(0.10, 0.25))
        mats = {"red": (0.55, y), "blue": (0.55, -y)}
        for color, place in mats.items():
            mat = self.fill_template(
                "zone/zone-template.urdf", {"DIM": (0.1, 0.1, 0.002), "COLOR": utils.COLORS[color]}
            )
            env.add_object(mat, ((*place, 0.001), (0, 0, 0, 1)), "fixed")

        blocks = {color: [] for color in mats}
        for color in mats:
            for _ in range(levels):
                pose = self.get_random_pose(env, (side, side, side))
                blocks[color].append(env.add_object(f"block/{color}_block.urdf", pose))

        # All blocks of a colour may go on any level, so a level is a goal over one block of each tower.
        for level in range(levels):
            self.add_goal(
                objs=[blocks[color][level] for color in mats],
                matches=np.eye(len(mats)),
                targ_poses=[((*place, side / 2 + level * side), (0, 0, 0, 1)) for place in mats.values()],
                replace=False,
                rotations=True,
                metric="pose",
                params=None,
                step_max_reward=1 / levels,
                symmetries=[np.pi / 2] * len(mats),
                language_goal=self.lang_template.format(level + 1),
            )
