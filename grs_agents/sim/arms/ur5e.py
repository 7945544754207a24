"""A UR5e: published masses, inertias and limits, our own capsules, joint angles in closed form."""

from typing import Any, Final

import numpy as np
import numpy.typing as npt

from grs_agents.base import Vec3
from grs_agents.sim.arms import ur5e_kinematics
from grs_agents.sim.arms.arm import HOME, Arm
from grs_agents.sim.arms.robot import Capsule, Link, add_chain
from grs_agents.sim.arms.ur5e_kinematics import A2, A3, D1, D4, D5, D6, LINKS, TURN

FloatArray = npt.NDArray[np.float64]
_NAMES: Final = ("shoulder", "upper_arm", "forearm", "wrist_1", "wrist_2", "wrist_3")
_CAPSULES: Final[tuple[Capsule, ...]] = (
    ((0.0, 0.0, 0.02), (0.0, 0.0, D1), 0.060),
    ((0.0, 0.0, 0.138), (A2, 0.0, 0.138), 0.054),
    ((0.0, 0.0, 0.007), (A3, 0.0, 0.007), 0.042),
    ((0.0, 0.0, 0.02), (0.0, 0.0, D4 - 0.02), 0.037),
    ((0.0, 0.0, 0.0), (0.0, 0.0, D5), 0.037),
    ((0.0, 0.0, 0.0), (0.0, 0.0, D6 - 0.02), 0.034),
)
# The maker's figures: kg; centre of mass and inertia in the Denavit-Hartenberg frame of each link; N m.
_MASSES: Final = (3.761, 8.058, 2.846, 1.37, 1.3, 0.365)
_CENTERS: Final[tuple[Vec3, ...]] = (
    (0.0, -0.02561, 0.00193), (0.2125, 0.0, 0.11336), (0.15, 0.0, 0.0265), (0.0, -0.0018, 0.01634),
    (0.0, 0.0018, 0.01634), (0.0, 0.0, -0.001159),
)  # fmt: skip
_INERTIAS: Final = (
    (7.00210e-3, 6.48091e-3, 6.57286e-3, 7.3e-7, -1.053e-5, 4.9994e-4),
    (1.505885e-2, 3.3388086e-1, 3.3247207e-1, -5.4e-5, 5.63e-6, -1.81e-6),
    (3.99632e-3, 7.879254e-2, 7.848510e-2, -1.365e-5, 1.37272e-3, -6.6e-6),
    (1.65491e-3, 1.35962e-3, 1.26279e-3, -2.82e-6, -4.38e-6, 1.0157e-4),
    (1.35617e-3, 1.27827e-3, 9.6614e-4, -2.74e-6, 4.44e-6, -5.048e-5),
    (1.8694e-4, 1.8908e-4, 2.5756e-4, 6e-8, -1.7e-7, -9.2e-7),
)
_TORQUES: Final = (150.0, 150.0, 150.0, 28.0, 28.0, 28.0)
_STIFFNESS: Final = (6000.0, 6000.0, 4000.0, 2000.0, 2000.0, 1000.0)


def _links() -> tuple[Link, ...]:
    found: list[Link] = []
    position, roll = (0.0, 0.0, 0.0), 0.0
    for index, (a, d, alpha) in enumerate(LINKS):
        cos, sin = float(np.cos(alpha)), float(np.sin(alpha))
        turn = np.array([[1.0, 0.0, 0.0], [0.0, cos, -sin], [0.0, sin, cos]])
        x, y, z = np.array([a, 0.0, d]) + turn @ np.asarray(_CENTERS[index])
        xx, yy, zz, xy, xz, yz = _INERTIAS[index]
        tensor = turn @ np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]) @ turn.T
        half = np.pi if index == 2 else TURN
        found.append(
            Link(
                name=_NAMES[index], position=position, roll=roll, limits=(-half, half), torque=_TORQUES[index],
                stiffness=_STIFFNESS[index], mass=_MASSES[index], center=(float(x), float(y), float(z)),
                inertia=(*np.diag(tensor).tolist(), float(tensor[0, 1]), float(tensor[0, 2]), float(tensor[1, 2])),
                capsules=(_CAPSULES[index],), touches=index >= 2,
            )
        )  # fmt: skip
        position, roll = (a, 0.0, d), alpha
    return tuple(found)


class UR5e(Arm):
    """Universal Robots' UR5e."""

    nearest, farthest = ur5e_kinematics.NEAREST, ur5e_kinematics.REACH

    def __init__(self) -> None:
        links = _links()

        def add(spec: Any) -> None:
            add_chain(spec, links, (0.0, 0.0, D6))

        super().__init__("ur5e", add, ur5e_kinematics.solve(np.array([HOME]), np.zeros(1))[0])

    def solve(self, tips: FloatArray, yaws: FloatArray, seed: FloatArray | None = None) -> FloatArray:
        """As ``Arm.solve``, in closed form."""
        joints = ur5e_kinematics.solve(tips, yaws)
        if seed is not None:
            joints[:, 5] += TURN * np.round((seed[5] - joints[0, 5]) / TURN)
        joints[~(np.abs(joints).max(axis=1) <= TURN)] = np.nan
        return joints

    def solve_poses(self, tips: FloatArray, rotations: FloatArray, seed: FloatArray | None = None) -> FloatArray:
        """As ``Arm.solve_poses``, in closed form."""
        return ur5e_kinematics.solve_poses(tips, rotations, self.home if seed is None else seed)

    def reachable(self, tips: FloatArray) -> npt.NDArray[np.bool_]:
        """As ``Arm.reachable``, in closed form."""
        return ur5e_kinematics.reachable(tips)
