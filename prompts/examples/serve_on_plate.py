"""Placing: typed goals in sequence, on(objects, support) for plates and again for what lies on one of them."""

from grs_agents.sim import Task, on


class ServeOnPlates(Task):
    """Put the yogurt on the left plate and the tuna on the right one, then the pudding on the tuna."""

    def __init__(self):
        super().__init__()
        self.max_steps = 6
        self.lang_template = "put the {} on the {}"
        self.task_completed_desc = "the meal is served."
        self.additional_reset()

    def reset(self, env):
        super().reset(env)
        height = env.library.asset("plate/plate.urdf").size[2] / 2
        x = float(env.rng.uniform(0.42, 0.58))
        left = env.add_object("plate/plate.urdf", ((x, 0.28, height), (0, 0, 0, 1)), "fixed")
        right = env.add_object("plate/plate.urdf", ((x, -0.28, height), (0, 0, 0, 1)), "fixed")
        yogurt = env.add_object("HOPE/Yogurt.urdf", ((0.42, -0.03, 0.027), (0, 0, 0, 1)))
        tuna = env.add_object("HOPE/Tuna.urdf", ((0.58, 0.05, 0.017), (0, 0, 0, 1)))
        pudding = env.add_object("HOPE/ChocolatePudding.urdf", ((0.66, -0.06, 0.025), (0, 0, 0, 1)))

        goals = [
            (on(yogurt, left), "yogurt", "left plate"),
            (on(tuna, right), "tuna", "right plate"),
            (on(pudding, tuna), "pudding", "can of tuna"),
        ]
        for relation, what, where in goals:
            words = self.lang_template.format(what, where)
            self.add_goal(relation, step_max_reward=1 / len(goals), language_goal=words)
