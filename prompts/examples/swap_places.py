"""Swapping: two things change places, although each target is taken at first."""

import numpy as np

from grs_agents.sim import Task


class SwapSoupAndYogurt(Task):
    """Let the soup can and the yogurt change places."""

    def __init__(self):
        super().__init__()
        self.max_steps = 6
        self.lang_template = "put the {} where the {} was"
        self.task_completed_desc = "they changed places."
        self.additional_reset()

    def reset(self, env):
        super().reset(env)
        places = [(0.45, -0.18), (0.55, 0.20)]
        soup = env.add_object("HOPE/AlphabetSoup.urdf", ((*places[0], 0.042), (0, 0, 0, 1)))
        yogurt = env.add_object("HOPE/Yogurt.urdf", ((*places[1], 0.027), (0, 0, 0, 1)))

        # The first target is occupied by the other object; the robot moves it aside first, hence the spare steps.
        for obj, place, words in ((soup, places[1], ("soup", "yogurt")), (yogurt, places[0], ("yogurt", "soup"))):
            height = env.get_object_size(obj)[2]
            self.add_goal(
                objs=[obj],
                matches=np.ones((1, 1)),
                targ_poses=[((*place, height / 2), (0, 0, 0, 1))],
                replace=False,
                rotations=False,
                metric="pose",
                params=None,
                step_max_reward=0.5,
                symmetries=[0],
                language_goal=self.lang_template.format(*words),
            )
