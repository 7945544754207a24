"""Bowls: things that roll; a ball lies where the middle of its bowl is, give or take 5 cm."""

import numpy as np

from grs_agents.sim import Task, utils


class BallsInBowls(Task):
    """Put a ball into each bowl: the warm colours left, the cold ones right."""

    def __init__(self):
        super().__init__()
        self.max_steps = 8
        self.pos_eps = 0.05
        self.lang_template = "put the {} balls into the bowls on the {}"
        self.task_completed_desc = "every ball is in a bowl."
        self.additional_reset()

    def reset(self, env):
        super().reset(env)
        bowl_size = env.library.asset("bowl/bowl.urdf").size
        ball_size = (0.04, 0.04, 0.04)
        for word, side, colors in (("warm", "left", ("red", "orange")), ("cold", "right", ("blue", "cyan"))):
            y = 0.30 if side == "left" else -0.30
            bowls = [((x, y, bowl_size[2] / 2), (0, 0, 0, 1)) for x in (0.36, 0.56)]
            for pose in bowls:
                env.add_object("bowl/bowl.urdf", pose, "fixed")
            balls = []
            for x, color in zip(env.rng.permutation((0.36, 0.56)), colors, strict=True):
                ball = self.fill_template("ball/ball-template.urdf", {"DIM": ball_size, "COLOR": utils.COLORS[color]})
                place = (float(x), float(env.rng.uniform(0.03, 0.12)) * (1 if side == "left" else -1), ball_size[2] / 2)
                balls.append(env.add_object(ball, (place, (0, 0, 0, 1))))
            self.add_goal(
                objs=balls,
                matches=np.ones((len(balls), len(bowls))),
                targ_poses=bowls,
                replace=False,
                rotations=False,
                metric="pose",
                params=None,
                step_max_reward=1 / 2,
                symmetries=[0] * len(balls),
                language_goal=self.lang_template.format(word, side),
            )
