"""Placing: between two things; the target is computed from where they stand."""

import numpy as np

from grs_agents.sim import Task, utils


class PutBetweenCylinders(Task):
    """Put the two blocks between the red and the blue cylinder, in a row."""

    def __init__(self):
        super().__init__()
        self.max_steps = 5
        self.lang_template = "put the {} block between the cylinders, next to the {} one"
        self.task_completed_desc = "the blocks are in between."
        self.additional_reset()

    def reset(self, env):
        super().reset(env)
        dim = (0.05, 0.05, 0.08)
        yaw = float(env.rng.uniform(-np.pi / 3, np.pi / 3))
        middle = ((0.50, float(env.rng.uniform(-0.1, 0.1)), 0.0), utils.eulerXYZ_to_quatXYZW((0, 0, yaw)))
        for color, y in (("red", 0.15), ("blue", -0.15)):
            cylinder = self.fill_template("cylinder/cylinder-template.urdf", {"DIM": dim, "COLOR": utils.COLORS[color]})
            env.add_object(cylinder, utils.multiply(middle, ((0, y, dim[2] / 2), (0, 0, 0, 1))), "fixed")
        mat = self.fill_template("zone/zone-template.urdf", {"DIM": (0.08, 0.2, 0.002), "COLOR": utils.COLORS["white"]})
        env.add_object(mat, middle, "fixed")

        goals = [("yellow", "red", 0.05), ("green", "blue", -0.05)]
        blocks = []
        for color, _, _ in goals:
            pose = self.get_random_pose(env, (0.04, 0.04, 0.04))
            blocks.append(env.add_object(f"block/{color}_block.urdf", pose))
        for block, (color, neighbour, y) in zip(blocks, goals, strict=True):
            self.add_goal(
                objs=[block],
                matches=np.ones((1, 1)),
                targ_poses=[utils.multiply(middle, ((0, y, 0.02), (0, 0, 0, 1)))],
                replace=False,
                rotations=True,
                metric="pose",
                params=None,
                step_max_reward=0.5,
                symmetries=[np.pi / 2],
                language_goal=self.lang_template.format(color, neighbour),
            )
