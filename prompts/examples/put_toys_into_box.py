"""Packing: a typed goal says what is wanted, inside(objects, container), and the runtime finds places for all."""

from grs_agents.sim import Task, inside, utils


class PutToysIntoBox(Task):
    """Put all the blocks and cylinders into the toy box, wherever it stands."""

    def __init__(self):
        super().__init__()
        self.max_steps = 10
        self.lang_template = "put the toys into the box"
        self.task_completed_desc = "all toys are in the box."
        self.additional_reset()

    def reset(self, env):
        super().reset(env)
        box_size = env.library.asset("container/open_box.urdf").size
        box = env.add_object("container/open_box.urdf", self.get_random_pose(env, box_size), "fixed")

        toys = []
        for color in ("red", "yellow", "blue"):
            pose = self.get_random_pose(env, (0.04, 0.04, 0.04))
            toys.append(env.add_object(f"block/{color}_block.urdf", pose))
        for color in ("green", "orange"):
            dim = (0.05, 0.05, float(env.rng.uniform(0.03, 0.07)))
            cylinder = self.fill_template("cylinder/cylinder-template.urdf", {"DIM": dim, "COLOR": utils.COLORS[color]})
            toys.append(env.add_object(cylinder, self.get_random_pose(env, dim)))

        # Scored strictly: below the rim, within the walls, and held by the box or by what lies in it.
        self.add_goal(inside(toys, box), step_max_reward=1.0, language_goal=self.lang_template)
