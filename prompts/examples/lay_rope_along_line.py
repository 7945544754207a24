"""Ropes: a rope is laid along a line; make_ropes gives its beads, their targets and matches."""

from grs_agents.sim import Task, utils


class LayRopeAlongLine(Task):
    """Lay the rope straight along the green line."""

    def __init__(self):
        super().__init__()
        self.max_steps = 20
        self.pos_eps = 0.02
        self.lang_template = "lay the rope along the green line"
        self.task_completed_desc = "the rope lies straight."
        self.additional_reset()

    def reset(self, env):
        super().reset(env)
        length = 0.28
        line_size = (length, 0.01, 0.001)
        line_pose = self.get_random_pose(env, line_size)
        line = self.fill_template("line/line-template.urdf", {"DIM": line_size, "COLOR": utils.COLORS["green"]})
        env.add_object(line, line_pose, "fixed")

        # The rope lies somewhere else at first, in a curve; its beads are to lie between the line's two ends.
        ends = [utils.apply(line_pose, (x, 0, 0.005)) for x in (-length / 2, length / 2)]
        beads, targets, matches = self.make_ropes(env, ends, n_parts=20, color_name="red")

        self.add_goal(
            objs=beads,
            matches=matches,
            targ_poses=targets,
            replace=False,
            rotations=False,
            metric="pose",
            params=None,
            step_max_reward=1.0,
            language_goal=self.lang_template,
        )
