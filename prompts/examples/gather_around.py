"""Placing: a typed goal, near(objects, other, distance); the gap counts, the side does not."""

from grs_agents.sim import Task, near


class GatherAroundCarton(Task):
    """Bring the three cans close to the orange juice."""

    def __init__(self):
        super().__init__()
        self.max_steps = 6
        self.lang_template = "bring the can of {} close to the orange juice"
        self.task_completed_desc = "the cans stand around the carton."
        self.additional_reset()

    def reset(self, env):
        super().reset(env)
        carton_size = env.library.asset("HOPE/OrangeJuice.urdf").size
        place = (float(env.rng.uniform(0.45, 0.55)), float(env.rng.uniform(-0.05, 0.05)), carton_size[2] / 2)
        carton = env.add_object("HOPE/OrangeJuice.urdf", (place, (0, 0, 0, 1)))
        cans = {
            "corn": env.add_object("HOPE/Corn.urdf", ((0.40, 0.33, 0.029), (0, 0, 0, 1))),
            "peaches": env.add_object("HOPE/Peaches.urdf", ((0.60, 0.34, 0.029), (0, 0, 0, 1))),
            "tuna": env.add_object("HOPE/Tuna.urdf", ((0.45, -0.35, 0.017), (0, 0, 0, 1))),
        }
        for word, can in cans.items():
            self.add_goal(
                near(can, carton, distance=0.05),
                step_max_reward=1 / len(cans),
                language_goal=self.lang_template.format(word),
            )
