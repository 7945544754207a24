"""Pattern: mirror what lies on one side of a line; blocks of one colour may change places."""

import numpy as np

from grs_agents.sim import Task, utils


class MirrorPattern(Task):
    """Lay the loose blocks out on the right of the line as the fixed ones lie on the left of it."""

    def __init__(self):
        super().__init__()
        self.max_steps = 8
        self.lang_template = "mirror the blocks on the left of the line to its right"
        self.task_completed_desc = "the pattern is mirrored."
        self.additional_reset()

    def reset(self, env):
        super().reset(env)
        side = 0.04
        line = self.fill_template(
            "zone/zone-template.urdf", {"DIM": (0.4, 0.01, 0.002), "COLOR": utils.COLORS["black"]}
        )
        env.add_object(line, ((0.50, 0, 0.001), (0, 0, 0, 1)), "fixed")

        # Cells of a grid are 8 cm apart, so the blocks of the pattern never touch.
        cells = [(x, y) for x in (0.38, 0.46, 0.54, 0.62) for y in (0.08, 0.16, 0.24)]
        places = env.rng.permutation(cells)[:4]
        colors = ["red", "red", "yellow", "blue"]
        for (x, y), color in zip(places, colors, strict=True):
            env.add_object(f"block/{color}_block.urdf", ((x, y, side / 2), (0, 0, 0, 1)), "fixed")
        targets = [((x, -y, side / 2), (0, 0, 0, 1)) for x, y in places]

        blocks = []
        for x, color in zip((0.30, 0.38, 0.46, 0.54), env.rng.permutation(colors), strict=True):
            blocks.append((env.add_object(f"block/{color}_block.urdf", ((x, -0.38, side / 2), (0, 0, 0, 1))), color))

        self.add_goal(
            objs=[block for block, _ in blocks],
            matches=np.array([[int(own == color) for color in colors] for _, own in blocks]),
            targ_poses=targets,
            replace=False,
            rotations=True,
            metric="pose",
            params=None,
            step_max_reward=1.0,
            symmetries=[np.pi / 2] * len(blocks),
            language_goal=self.lang_template,
        )
