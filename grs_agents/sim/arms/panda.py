"""The Franka Emika Panda: published geometry, limits, masses and inertias, our own collision capsules."""

from typing import Any, Final

import numpy as np

from grs_agents.base.geometry.transforms import FloatArray
from grs_agents.sim.arms.arm import Arm
from grs_agents.sim.arms.arm_looks import MOUNT, housing, ring, tube
from grs_agents.sim.arms.arm_parts import Capsule, Link, add_link_chain
from grs_agents.sim.hands.hand import Hand
from grs_agents.sim.hands.suction_cup import SUCTION_CUP

_JOINTS: Final = np.loadtxt(
    """
    0.0     0.333  0  -2.8973   2.8973  87  4500  4.970684   3.875e-3   2.081e-3  -0.04762
    0.0     0.0   -1  -1.7628   1.7628  87  4500  0.646926  -3.141e-3  -0.02872    3.495e-3
    0.0     0.316  1  -2.8973   2.8973  87  3500  3.228604   2.7518e-2  3.9252e-2 -6.6502e-2
    0.0825  0.0    1  -3.0718  -0.0698  87  3500  3.587895  -5.317e-2   0.104419   2.7454e-2
   -0.0825  0.384 -1  -2.8973   2.8973  12  1200  1.225946  -1.1953e-2  4.1065e-2 -3.8437e-2
    0.0     0.0    1  -0.0175   3.7525  12  1200  1.666555   6.0149e-2 -1.4117e-2 -1.0517e-2
    0.088   0.0    1  -2.8973   2.8973  12   800  0.735522   1.0517e-2 -4.252e-3   6.1597e-2
    """.splitlines()
).tolist()
"""For each joint: modified Denavit-Hartenberg parameters a, d (m) and alpha (quarter turns), lowest and highest angle
(rad), torque (N m), stiffness (N m/rad); mass (kg) and its centre (m), identified and published with the maker's
description."""
_FLANGE: Final = (0.0, 0.0, 0.107)
_INERTIAS: Final = (
    (0.70337, 0.70661, 9.117e-3, -1.39e-4, 6.772e-3, 1.9169e-2),
    (7.962e-3, 2.811e-2, 2.5995e-2, -3.925e-3, 1.0254e-2, 7.04e-4),
    (3.7242e-2, 3.6155e-2, 1.083e-2, -4.761e-3, -1.1396e-2, -1.2805e-2),
    (2.5853e-2, 1.9552e-2, 2.8323e-2, 7.796e-3, -1.332e-3, 8.641e-3),
    (3.5549e-2, 2.9474e-2, 8.627e-3, -2.117e-3, -4.037e-3, 2.29e-4),
    (1.964e-3, 4.354e-3, 5.433e-3, 1.09e-4, -1.158e-3, 3.41e-4),
    (1.2516e-2, 1.0027e-2, 4.815e-3, -4.28e-4, -1.196e-3, -7.41e-4),
)
"""From the same source, about the centre of mass: xx, yy, zz, xy, xz, yz, kg m^2."""
_CAPSULES: Final[tuple[tuple[Capsule, ...], ...]] = (
    (((0.0, 0.0, -0.25), (0.0, 0.0, 0.0), 0.060),),
    (((0.0, 0.0, -0.05), (0.0, 0.0, 0.05), 0.060), ((0.0, -0.06, 0.0), (0.0, -0.16, 0.0), 0.055)),
    (((0.0, 0.0, -0.12), (0.0, 0.0, -0.06), 0.055), ((0.03, 0.0, -0.03), (0.0825, 0.0, 0.0), 0.055)),
    (((0.0, 0.0, -0.05), (0.0, 0.0, 0.05), 0.055), ((-0.06, 0.07, 0.0), (-0.0825, 0.12, 0.0), 0.055)),
    (((0.0, 0.0, -0.23), (0.0, 0.01, -0.13), 0.055), ((0.0, 0.07, -0.13), (0.0, 0.06, -0.02), 0.035)),
    (((0.0, 0.0, -0.04), (0.0, 0.0, 0.02), 0.050), ((0.03, 0.0, 0.0), (0.088, 0.0, 0.0), 0.045)),
    (((0.0, 0.0, 0.0), (0.0, 0.0, 0.075), 0.044),),
)
_SPEEDS: Final[FloatArray] = np.array([2.175] * 4 + [2.61] * 3)
"""The greatest speeds of the joints by the maker's data sheet, rad/s."""
_GUESS: Final = (0.0, -np.pi / 4, 0.0, -3 * np.pi / 4, 0.0, np.pi / 2, 0.0)


_LOOKS: Final = (
    *ring("world", (0.0, 0.0, 0.0), (0.0, 0.0, 0.015), 0.085),
    *tube("world", (-0.06, 0.0, 0.055), (0.0, 0.0, 0.06), 0.055),
    *tube("world", (0.0, 0.0, 0.03), (0.0, 0.0, 0.085), 0.06),
    *ring("link_1", (0.0, 0.0, -0.193), (0.0, 0.0, -0.185), 0.062),
    *tube("link_1", (0.0, 0.0, -0.13), (0.0, 0.0, -0.05), 0.058),
    *housing("link_1", (0.0, 0.0, -0.185), (0.0, 0.0, -0.13), 0.06, ""),
    *housing("link_2", (0.0, 0.0, -0.06), (0.0, 0.0, 0.06), 0.058, "start end"),
    *tube("link_2", (0.0, 0.0, 0.0), (0.0, -0.09, 0.0), 0.0545),
    *housing("link_2", (0.0, -0.09, 0.0), (0.0, -0.146, 0.0), 0.056, ""),
    *ring("link_3", (0.0, 0.0, -0.17), (0.0, 0.0, -0.162), 0.058),
    *housing("link_3", (0.0, 0.0, -0.162), (0.0, 0.0, -0.08), 0.055, ""),
    *tube("link_3", (0.0, 0.0, -0.08), (0.03, 0.0, -0.03), 0.0535),
    *tube("link_3", (0.03, 0.0, -0.03), (0.0825, 0.0, 0.0), 0.05),
    *housing("link_4", (0.0, 0.0, -0.058), (0.0, 0.0, 0.058), 0.055, "start end"),
    *tube("link_4", (0.0, 0.0, 0.0), (-0.0825, 0.085, 0.0), 0.0485),
    *housing("link_4", (-0.0825, 0.085, 0.0), (-0.0825, 0.122, 0.0), 0.05, ""),
    *ring("link_5", (0.0, 0.0, -0.262), (0.0, 0.0, -0.254), 0.052),
    *housing("link_5", (0.0, 0.0, -0.254), (0.0, 0.0, -0.22), 0.05, ""),
    *tube("link_5", (0.0, 0.0, -0.22), (0.0, 0.055, -0.14), 0.046),
    *tube("link_5", (0.0, 0.055, -0.14), (0.0, 0.055, -0.01), 0.036),
    *housing("link_6", (0.0, 0.0, -0.05), (0.0, 0.0, 0.05), 0.047, "start end"),
    *tube("link_6", (0.0, 0.0, 0.0), (0.088, 0.0, 0.0), 0.044),
    *housing("link_6", (0.088, 0.046, 0.0), (0.088, -0.046, 0.0), 0.044, "start"),
    *ring("link_7", (0.0, 0.0, 0.046), (0.0, 0.0, 0.054), 0.045),
    *housing("link_7", (0.0, 0.0, 0.054), (0.0, 0.0, 0.095), 0.042, ""),
    *ring("link_7", (0.0, 0.0, 0.095), (0.0, 0.0, 0.107), 0.0315),
    *ring(MOUNT, (0.0, 0.0, 0.0), (0.0, 0.0, 0.012), 0.02),
)
"""Along the published frames: flange 63 mm, the big joints about 0.11 m across."""


class Panda(Arm):
    """Franka Emika's Panda, seven joints."""

    looks, maker_speeds = _LOOKS, _SPEEDS

    def __init__(self, hand: Hand = SUCTION_CUP) -> None:
        links: list[Link] = []
        for index, (a, d, quarters, low, high, torque, stiffness, mass, x, y, z) in enumerate(_JOINTS):
            alpha = quarters * np.pi / 2
            link = Link(
                name=f"link_{index + 1}",
                position=(a, -float(np.sin(alpha)) * d, float(np.cos(alpha)) * d),
                roll=alpha,
                limits=(low, high),
                torque=torque,
                stiffness=stiffness,
                mass=mass,
                center=(x, y, z),
                inertia=_INERTIAS[index],
                capsules=_CAPSULES[index],
            )
            links.append(link)

        def add(spec: Any, moving: bool) -> None:
            add_link_chain(spec, links, _FLANGE, hand, moving)

        super().__init__("panda", add, np.array(_GUESS), hand)
