"""Building: two pillars and a beam across; long things look the same after half a turn, symmetry pi."""

import numpy as np

from grs_agents.sim import Task, utils


class BuildBridge(Task):
    """Stand the two pillars on their marks, then lay the beam across them."""

    def __init__(self):
        super().__init__()
        self.max_steps = 7
        self.lang_template = "build a bridge: {}"
        self.task_completed_desc = "the bridge stands."
        self.additional_reset()

    def reset(self, env):
        super().reset(env)
        pillar_size, beam_size, span = (0.05, 0.05, 0.06), (0.20, 0.05, 0.02), 0.14
        turn = utils.eulerXYZ_to_quatXYZW((0, 0, float(env.rng.uniform(-np.pi / 2, np.pi / 2))))
        frame = ((0.50, float(env.rng.uniform(-0.15, 0.15)), 0.0), turn)
        river = self.fill_template(
            "zone/zone-template.urdf", {"DIM": (0.22, 0.12, 0.002), "COLOR": utils.COLORS["cyan"]}
        )
        env.add_object(river, frame, "fixed")

        pillar = self.fill_template("box/box-template.urdf", {"DIM": pillar_size, "COLOR": utils.COLORS["gray"]})
        pillars = [env.add_object(pillar, self.get_random_pose(env, pillar_size)) for _ in range(2)]
        beam = self.fill_template("box/box-template.urdf", {"DIM": beam_size, "COLOR": utils.COLORS["brown"]})
        beam = env.add_object(beam, self.get_random_pose(env, beam_size))

        feet = [utils.multiply(frame, ((x, 0, pillar_size[2] / 2), (0, 0, 0, 1))) for x in (-span / 2, span / 2)]
        deck = utils.multiply(frame, ((0, 0, pillar_size[2] + beam_size[2] / 2), (0, 0, 0, 1)))
        for objects, targets, symmetry, words in (
            (pillars, feet, np.pi / 2, "stand the pillars on the banks"),
            ([beam], [deck], np.pi, "lay the beam on the pillars"),
        ):
            self.add_goal(
                objs=objects,
                matches=np.ones((len(objects), len(targets))),
                targ_poses=targets,
                replace=False,
                rotations=True,
                metric="pose",
                params=None,
                step_max_reward=len(objects) / 3,
                symmetries=[symmetry] * len(objects),
                language_goal=self.lang_template.format(words),
            )
