"""Matching: each block goes onto the pad of its colour; one goal whose matches pair rows with columns."""

import numpy as np

from grs_agents.sim import Task, utils


class MatchPairs(Task):
    """Put every block on the pad of its own colour; there are two blocks and two pads of each colour."""

    def __init__(self):
        super().__init__()
        self.max_steps = 12
        self.lang_template = "match each block with a pad of its colour"
        self.task_completed_desc = "all pairs match."
        self.additional_reset()

    def reset(self, env):
        super().reset(env)
        colors = [str(color) for color in env.rng.permutation(["red", "green", "blue", "yellow"])[:3]]
        pad_colors = [str(color) for color in env.rng.permutation(colors * 2)]
        pad_size = (0.07, 0.07, 0.01)
        places = [(x, y) for x in (0.42, 0.56) for y in (-0.14, 0.0, 0.14)]
        pads = []
        for color, (x, y) in zip(pad_colors, places, strict=True):
            pad = self.fill_template("box/box-template.urdf", {"DIM": pad_size, "COLOR": utils.COLORS[color]})
            env.add_object(pad, ((x, y, pad_size[2] / 2), (0, 0, 0, 1)), "fixed")
            pads.append(((x, y, pad_size[2] + 0.02), (0, 0, 0, 1)))

        block_colors = colors * 2
        blocks = []
        for color in block_colors:
            pose = self.get_random_pose(env, (0.04, 0.04, 0.04))
            blocks.append(env.add_object(f"block/{color}_block.urdf", pose))

        # Row and column agree where the colours do: two ones in each row.
        matches = np.array([[int(own == other) for other in pad_colors] for own in block_colors])
        self.add_goal(
            objs=blocks,
            matches=matches,
            targ_poses=pads,
            replace=False,
            rotations=False,
            metric="pose",
            params=None,
            step_max_reward=1.0,
            symmetries=[0] * len(blocks),
            language_goal=self.lang_template,
        )
