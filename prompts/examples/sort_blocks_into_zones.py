"""Sorting: blocks into the zone of their colour; zones lie at random, one goal for each colour."""

import numpy as np

from grs_agents.sim import Task, utils


class SortBlocksIntoZones(Task):
    """Move every block into the zone of its own colour."""

    def __init__(self):
        super().__init__()
        self.max_steps = 12
        self.lang_template = "move the {} blocks into the {} zone"
        self.task_completed_desc = "done sorting blocks."
        self.additional_reset()

    def reset(self, env):
        super().reset(env)
        colors = [
            str(color) for color in env.rng.choice(["red", "green", "blue", "yellow", "purple"], 2, replace=False)
        ]
        zone_size = (0.18, 0.18, 0.002)
        zones = {}
        for color in colors:
            zones[color] = self.get_random_pose(env, zone_size)
            zone = self.fill_template("zone/zone-template.urdf", {"DIM": zone_size, "COLOR": utils.COLORS[color]})
            env.add_object(zone, zones[color], "fixed")

        # Zones count as taken, so a random pose never starts a block in its zone.
        for color in colors:
            blocks = []
            for _ in range(3):
                pose = self.get_random_pose(env, (0.04, 0.04, 0.04))
                blocks.append(env.add_object("block/block.urdf", pose, color=utils.COLORS[color]))
            self.add_goal(
                objs=blocks,
                matches=np.ones((len(blocks), 1)),
                targ_poses=[zones[color]],
                replace=True,
                rotations=False,
                metric="zone",
                params=[(zones[color], zone_size)],
                step_max_reward=1 / len(colors),
                language_goal=self.lang_template.format(color, color),
            )
