"""Palletizing: equal boxes in layers on a pallet; all boxes of a layer are one goal."""

import numpy as np

from grs_agents.sim import Task, utils


class PalletizeBoxes(Task):
    """Stack six boxes on the pallet: four below, two across them."""

    def __init__(self):
        super().__init__()
        self.max_steps = 12
        self.lang_template = "stack all the boxes on the pallet, layer {}"
        self.task_completed_desc = "done palletizing."
        self.additional_reset()

    def reset(self, env):
        super().reset(env)
        pallet_size = env.library.asset("pallet/pallet.urdf").size
        yaw = utils.eulerXYZ_to_quatXYZW((0, 0, float(env.rng.uniform(-np.pi / 4, np.pi / 4))))
        pallet_pose = ((0.50, float(env.rng.choice([-1, 1]) * 0.25), pallet_size[2] / 2), yaw)
        env.add_object("pallet/pallet.urdf", pallet_pose, "fixed")

        # Long sides along x below; above the boxes are turned by 90 degrees and lie over the joint.
        x, y, z = box_size = (0.12, 0.08, 0.05)
        gap, top = 0.006, pallet_size[2] / 2
        quarter = utils.eulerXYZ_to_quatXYZW((0, 0, np.pi / 2))
        ahead, aside = (x + gap) / 2, (y + gap) / 2
        layers = [
            [((dx, dy, top + z / 2), (0, 0, 0, 1)) for dx in (-ahead, ahead) for dy in (-aside, aside)],
            [((dx, 0, top + 1.5 * z), quarter) for dx in (-ahead, ahead)],
        ]
        for number, layer in enumerate(layers, start=1):
            boxes = []
            for _ in layer:
                box = self.fill_template("box/box-template.urdf", {"DIM": box_size, "COLOR": utils.COLORS["brown"]})
                boxes.append(env.add_object(box, self.get_random_pose(env, box_size)))
                self.color_random_brown(boxes[-1])
            self.add_goal(
                objs=boxes,
                matches=np.ones((len(boxes), len(layer))),
                targ_poses=[utils.multiply(pallet_pose, place) for place in layer],
                replace=False,
                rotations=True,
                metric="pose",
                params=None,
                step_max_reward=len(boxes) / 6,
                symmetries=[np.pi] * len(boxes),
                language_goal=self.lang_template.format(number),
            )
