"""Choosing: the words name a colour; things of other colours are distractors, which stay where they are."""

import numpy as np

from grs_agents.sim import Task, utils


class ChooseByColor(Task):
    """Put the blocks of the named colour into the box and leave the others alone."""

    def __init__(self):
        super().__init__()
        self.max_steps = 5
        self.lang_template = "put only the {} blocks into the box"
        self.task_completed_desc = "done choosing."
        self.additional_reset()

    def reset(self, env):
        super().reset(env)
        box_size = (0.18, 0.18, 0.05)
        box_pose = self.get_random_pose(env, box_size)
        box = self.fill_template("container/container-template.urdf", {"DIM": box_size, "COLOR": utils.COLORS["brown"]})
        env.add_object(box, box_pose, "fixed")

        chosen, *others = env.rng.permutation(["red", "green", "blue", "yellow", "orange"])
        wanted = []
        for _ in range(2):
            pose = self.get_random_pose(env, (0.04, 0.04, 0.04))
            wanted.append(env.add_object(f"block/{chosen}_block.urdf", pose))
        for color in others:
            pose = self.get_random_pose(env, (0.04, 0.04, 0.04))
            env.add_object(f"block/{color}_block.urdf", pose)

        self.add_goal(
            objs=wanted,
            matches=np.ones((len(wanted), 1)),
            targ_poses=[box_pose],
            replace=True,
            rotations=False,
            metric="zone",
            params=[(box_pose, box_size)],
            step_max_reward=1.0,
            language_goal=self.lang_template.format(chosen),
        )
