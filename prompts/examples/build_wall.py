"""Building: a wall of bricks laid in bond, a row on a row; a brick may take any place of its row."""

import numpy as np

from grs_agents.sim import Task, utils


class BuildWall(Task):
    """Build a wall between the two mats: three bricks below, two above, each over a joint."""

    def __init__(self):
        super().__init__()
        self.max_steps = 10
        self.lang_template = "build a barrier between the red and the blue mat, {} row"
        self.task_completed_desc = "the barrier stands."
        self.additional_reset()

    def reset(self, env):
        super().reset(env)
        brick_size, pitch = (0.10, 0.04, 0.04), 0.11
        y = float(env.rng.uniform(-0.05, 0.05))
        for color, side in (("red", 0.10), ("blue", -0.10)):
            mat = self.fill_template(
                "zone/zone-template.urdf", {"DIM": (0.32, 0.1, 0.002), "COLOR": utils.COLORS[color]}
            )
            env.add_object(mat, ((0.50, y + side, 0.001), (0, 0, 0, 1)), "fixed")
        site = self.fill_template(
            "zone/zone-template.urdf", {"DIM": (0.32, 0.05, 0.002), "COLOR": utils.COLORS["gray"]}
        )
        env.add_object(site, ((0.50, y, 0.001), (0, 0, 0, 1)), "fixed")

        brick = self.fill_template("box/box-template.urdf", {"DIM": brick_size, "COLOR": utils.COLORS["orange"]})
        for count, word in ((3, "first"), (2, "second")):
            level = 3 - count
            places = [0.50 + (index - (count - 1) / 2) * pitch for index in range(count)]
            self.add_goal(
                objs=[env.add_object(brick, self.get_random_pose(env, brick_size)) for _ in range(count)],
                matches=np.ones((count, count)),
                targ_poses=[((x, y, (level + 0.5) * brick_size[2]), (0, 0, 0, 1)) for x in places],
                replace=False,
                rotations=True,
                metric="pose",
                params=None,
                step_max_reward=count / 5,
                symmetries=[np.pi] * count,
                language_goal=self.lang_template.format(word),
            )
