"""Alignment: a typed goal, aligned(objects, spacing): one line and even distances, wherever it lies."""

from grs_agents.sim import Task, aligned


class LineUpCans(Task):
    """Line the four cans up with 12 cm from one to the next."""

    def __init__(self):
        super().__init__()
        self.max_steps = 8
        self.lang_template = "line the cans up, 12 cm apart"
        self.task_completed_desc = "the cans are in line."
        self.additional_reset()

    def reset(self, env):
        super().reset(env)
        cans = []
        for name in ("Corn", "Peaches", "GreenBeans", "TomatoSauce"):
            size = env.library.asset(f"HOPE/{name}.urdf").size
            cans.append(env.add_object(f"HOPE/{name}.urdf", self.get_random_pose(env, size)))

        self.add_goal(aligned(cans, spacing=0.12), step_max_reward=1.0, language_goal=self.lang_template)
