"""Placing: typed goals in sequence, on(objects, support) for a plate and again for what lies on it."""

from grs_agents.sim import Task, on


class ServeOnPlate(Task):
    """Put the yogurt and the tuna on the plate, then the pudding on the tuna."""

    def __init__(self):
        super().__init__()
        self.max_steps = 6
        self.lang_template = "put {} on the {}"
        self.task_completed_desc = "the meal is served."
        self.additional_reset()

    def reset(self, env):
        super().reset(env)
        plate_size = env.library.asset("plate/plate.urdf").size
        side = float(env.rng.choice([-1, 1]))
        plate = env.add_object("plate/plate.urdf", ((0.50, side * 0.25, plate_size[2] / 2), (0, 0, 0, 1)), "fixed")
        yogurt = env.add_object("HOPE/Yogurt.urdf", ((0.42, -side * 0.05, 0.027), (0, 0, 0, 1)))
        tuna = env.add_object("HOPE/Tuna.urdf", ((0.58, -side * 0.10, 0.017), (0, 0, 0, 1)))
        pudding = env.add_object("HOPE/ChocolatePudding.urdf", ((0.46, -side * 0.26, 0.025), (0, 0, 0, 1)))

        goals = [
            (on([yogurt, tuna], plate), "the yogurt and the tuna", "plate"),
            (on(pudding, tuna), "the pudding", "tuna"),
        ]
        for relation, what, where in goals:
            self.add_goal(
                relation, step_max_reward=1 / len(goals), language_goal=self.lang_template.format(what, where)
            )
