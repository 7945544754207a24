"""Packing: groceries into an open box that stands where the photo shows nothing."""

from grs_agents.sim import Task, inside, utils


class PackGroceriesIntoBox(Task):
    """Put every grocery item on the table into the open box."""

    def __init__(self):
        super().__init__()
        self.max_steps = 8
        self.lang_template = "put the groceries into the open box"
        self.task_completed_desc = "done packing."
        self.additional_reset()

    def reset(self, env):
        super().reset(env)

        # The box stands where the photo shows nothing; a fixed object cannot be pushed away.
        box_size = (0.34, 0.26, 0.08)
        box_pose = ((0.50, -0.15, box_size[2] / 2), (0, 0, 0, 1))
        box = self.fill_template("container/container-template.urdf", {"DIM": box_size, "COLOR": utils.COLORS["brown"]})
        box_id = env.add_object(box, box_pose, "fixed")

        # Items stand where the photo shows them.
        items = [
            ("HOPE/TomatoSauce.urdf", ((0.42, 0.22, 0.042), (0, 0, 0, 1))),
            ("HOPE/Tuna.urdf", ((0.58, 0.20, 0.017), (0, 0, 0, 1))),
            ("HOPE/Butter.urdf", ((0.50, 0.32, 0.027), (0, 0, 0, 1))),
        ]
        objects = [env.add_object(urdf, pose) for urdf, pose in items]

        self.add_goal(inside(objects, box_id), step_max_reward=1.0, language_goal=self.lang_template)
