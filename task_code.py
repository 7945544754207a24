import numpy as np

from grs_agents.sim import Task, utils


class PackTunaCanAndRedBlockCubeAndMoreIntoOpenBox(Task):
    """Pick up the tuna can, the red block cube, the orange juice carton, the tomato sauce can, the raisins box and the blue block cube and put everything into the open box."""

    def __init__(self):
        super().__init__()
        self.max_steps = 11
        self.lang_template = "put the {} into the {}"
        self.task_completed_desc = "task completed."
        self.additional_reset()

    def reset(self, env):
        super().reset(env)

        # The objects, where the photo shows them.
        tuna_1 = env.add_object("HOPE/Tuna.urdf", ((0.62, -0.235, 0.016), (0, 0, -0.12, 0.993)))
        red_block_1 = env.add_object("block/red_block.urdf", ((0.661, -0.343, 0.02), (0, 0, 0.013, 1)))
        orange_juice_1 = env.add_object("HOPE/OrangeJuice.urdf", ((0.34, -0.225, 0.096), (0, 0, -0.017, 1)))
        tomato_sauce_1 = env.add_object("HOPE/TomatoSauce.urdf", ((0.34, 0.175, 0.041), (0, 0, 0, 1)))
        raisins_1 = env.add_object("HOPE/Raisins.urdf", ((0.34, 0.305, 0.061), (0, 0, 0.022, 1)))
        blue_block_1 = env.add_object("block/blue_block.urdf", ((0.571, -0.344, 0.02), (0, 0, 0, 1)))

        # The open box serves where it stands.
        open_box_1_size = (0.22, 0.3, 0.09)
        open_box_1_pose = ((0.582, 0.23, 0.045), (0, 0, 0, 1))
        env.add_object("container/open_box.urdf", (open_box_1_pose[0], (0, 0, 0.707, 0.707)), "fixed")

        # One goal for each object, in the order in which the robot moves them:
        # object, its name, where to (name, pose, size), offset from there, rotation.
        moves = [
            (tuna_1, "tuna can", "open box", open_box_1_pose, open_box_1_size, (-0.045, -0.0745, -0.0185), (0, 0, -0.12, 0.993)),
            (red_block_1, "red block cube", "open box", open_box_1_pose, open_box_1_size, (-0.045, -0.001, -0.015), (0, 0, 0.013, 1)),
            (orange_juice_1, "orange juice carton", "open box", open_box_1_pose, open_box_1_size, (-0.045, 0.0735, 0.061), (0, 0, -0.017, 1)),
            (tomato_sauce_1, "tomato sauce can", "open box", open_box_1_pose, open_box_1_size, (0.0465, -0.084, 0.0065), (0, 0, 0, 1)),
            (raisins_1, "raisins box", "open box", open_box_1_pose, open_box_1_size, (0.0465, 0.013, 0.0265), (0, 0, 0.022, 1)),
            (blue_block_1, "blue block cube", "open box", open_box_1_pose, open_box_1_size, (0.0465, 0.097, -0.015), (0, 0, 0, 1)),
        ]
        for item, label, place, pose, size, offset, rotation in moves:
            target = utils.multiply(pose, (offset, rotation))
            self.add_goal(
                objs=[item],
                matches=np.int32([[1]]),
                targ_poses=[target],
                replace=False,
                rotations=True,
                metric="zone",
                params=[(pose, size)],
                step_max_reward=1 / len(moves),
                language_goal=self.lang_template.format(label, place),
            )
