"""Tidying: different typed goals after each other: on a plate, inside a bowl, near a plate."""

from grs_agents.sim import Task, inside, near, on


class LayBreakfast(Task):
    """Set the bowl on the plate, put the berries into the bowl, and stand the mug beside the plate."""

    def __init__(self):
        super().__init__()
        self.max_steps = 8
        self.lang_template = "put the {}"
        self.task_completed_desc = "breakfast is ready."
        self.additional_reset()

    def reset(self, env):
        super().reset(env)
        sizes = {word: env.library.asset(f"{word}/{word}.urdf").size for word in ("plate", "bowl", "mug")}
        y = float(env.rng.uniform(-0.05, 0.05))
        plate = env.add_object("plate/plate.urdf", ((0.52, y, sizes["plate"][2] / 2), (0, 0, 0, 1)), "fixed")
        bowl = env.add_object("bowl/bowl.urdf", ((0.48, 0.36, sizes["bowl"][2] / 2), (0, 0, 0, 1)))
        mug = env.add_object("mug/mug.urdf", ((0.42, -0.36, sizes["mug"][2] / 2), (0, 0, 0, 1)))
        berries = []
        for _ in range(2):
            pose = self.get_random_pose(env, (0.04, 0.04, 0.04))
            berries.append(env.add_object("block/red_block.urdf", pose))

        goals = [
            (on(bowl, plate), "bowl on the plate", 0.25),
            (inside(berries, bowl), "berries into the bowl", 0.5),
            (near(mug, plate, distance=0.06), "mug beside the plate", 0.25),
        ]
        for relation, words, reward in goals:
            self.add_goal(relation, step_max_reward=reward, language_goal=self.lang_template.format(words))
