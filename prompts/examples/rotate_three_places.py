"""Swapping: three things change places in turn; each target is where another one starts."""

import numpy as np

from grs_agents.sim import Task


class RotateThreePlaces(Task):
    """Let each can take the place of the next: corn to peaches, peaches to cherries, cherries to corn."""

    def __init__(self):
        super().__init__()
        self.max_steps = 8
        self.lang_template = "put the {} where the {} were"
        self.task_completed_desc = "all three have moved on."
        self.additional_reset()

    def reset(self, env):
        super().reset(env)
        names = {"corn": "HOPE/Corn.urdf", "peaches": "HOPE/Peaches.urdf", "cherries": "HOPE/Cherries.urdf"}
        height = env.library.asset("HOPE/Corn.urdf").size[2]
        places = [(0.42, 0.22, height / 2), (0.60, 0.0, height / 2), (0.42, -0.22, height / 2)]
        places = [tuple(place) for place in env.rng.permutation(places)]
        words = list(names)
        cans = [env.add_object(names[word], (place, (0, 0, 0, 1))) for word, place in zip(words, places, strict=True)]

        # Every target is taken at first: one can must wait aside, hence the spare steps.
        for index, can in enumerate(cans):
            following = (index + 1) % len(cans)
            self.add_goal(
                objs=[can],
                matches=np.ones((1, 1)),
                targ_poses=[(places[following], (0, 0, 0, 1))],
                replace=False,
                rotations=False,
                metric="pose",
                params=None,
                step_max_reward=1 / len(cans),
                symmetries=[0],
                language_goal=self.lang_template.format(words[index], words[following]),
            )
