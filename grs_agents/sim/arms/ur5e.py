"""The UR5e: published masses, inertias and limits, our own collision capsules, closed-form inverse kinematics.

Frames follow the published Denavit-Hartenberg parameters. The base is at the origin of the robot frame and the tip is
the end of its hand. With the tool down the wrist's second joint stays at -90 degrees and the arm moves in a
vertical plane, ``D4`` beside the base's axis: a planar problem with a single elbow-up solution. Any other pose of the
tool has up to eight solutions: shoulder left or right, wrist up or down, elbow up or down.
"""

import math
from itertools import product
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from grs_agents.base.geometry.transforms import FloatArray
from grs_agents.sim.arms.arm import HOME, Arm
from grs_agents.sim.arms.arm_looks import MOUNT, housing, ring, tube
from grs_agents.sim.arms.arm_parts import DOWN, Capsule, Link, add_link_chain
from grs_agents.sim.arms.joint_paths import rotations_about_z
from grs_agents.sim.hands.hand import Hand
from grs_agents.sim.hands.suction_cup import SUCTION_CUP

D1: Final = 0.1625
A2: Final = -0.425
A3: Final = -0.3922
D4: Final = 0.1333
D5: Final = 0.0997
D6: Final = 0.0996
TURN: Final = 2 * np.pi
_DOWN: Final = 1e-7
"""Largest tilt of a tool that counts as straight down, radians."""
REACH: Final = 0.85
"""Nominal reach of the arm from its base axis, metres."""
NEAREST: Final = 0.22
"""Least distance from the base axis, metres: closer, the arm would fold into itself."""
_SHOULDER: Final = 0.105
"""Clearance between the axes of shoulder and forearm: the sum of their radii and a margin, metres."""
_SHOULDER_TO_ELBOW: Final = ((0.0, D1, np.pi / 2), (A2, 0.0, 0.0), (A3, 0.0, 0.0))
LINKS: Final = (*_SHOULDER_TO_ELBOW, (0.0, D4, np.pi / 2), (0.0, D5, -np.pi / 2), (0.0, D6, 0.0))
"""(a, d, alpha) of each joint."""
Coordinate = float | FloatArray


def solve_ik_tool_down(tips: FloatArray, yaws: FloatArray, tool: float = SUCTION_CUP.length) -> FloatArray:
    """Continuous joint angles (N, 6) for tips (N, 3) and yaws (N,), tool (length in m) down; NaN out of reach."""
    if len(tips) == 1:  # a control period's: scalars take a third of the time of arrays
        ((x, y, z),), (yaw,) = tips.tolist(), yaws.tolist()
        base, shoulder, elbow = _solve_plane(x, y, z, tool)
        turn = base + np.pi / 2 - yaw
        turn = turn - TURN * round(turn / TURN) if math.isfinite(turn) else 0.0
        return np.array([[base, shoulder, elbow, -np.pi / 2 - shoulder - elbow, -np.pi / 2, turn]])
    base, shoulder, elbow = _solve_plane(tips[:, 0], tips[:, 1], tips[:, 2], tool)
    turns = base + np.pi / 2 - yaws
    if not np.isfinite(turns).all():
        turns = np.where(np.isfinite(turns), turns, 0.0)
    if float(np.abs(turns[1:] - turns[:-1]).max()) > np.pi:
        turns = np.unwrap(turns)
    joints = np.empty((len(tips), 6))
    joints[:, 0], joints[:, 1], joints[:, 2] = base, shoulder, elbow
    joints[:, 3], joints[:, 4] = -np.pi / 2 - shoulder - elbow, -np.pi / 2
    joints[:, 5] = turns - TURN * round(float(turns[0]) / TURN)
    return joints


def _solve_plane(x: Coordinate, y: Coordinate, z: Coordinate, tool: float) -> tuple[Any, Any, Any]:
    """Angles of base, shoulder and elbow for points of the tip (m), each a float or (N,); NaN out of reach."""
    height = z + tool + D6 - D1
    radius = np.hypot(x, y)
    with np.errstate(invalid="ignore", divide="ignore"):
        base = np.arctan2(y, x) + np.pi - np.arcsin(D4 / radius)
        forward = np.sqrt(radius * radius - D4**2) - D5
        cosine = _elbow_cosine(forward, height)
        elbow = np.arccos(cosine)  # NaN beyond 1
    # The links have negative lengths in the published table, so the arm extends along minus x of link 1.
    shoulder = np.arctan2(-height, forward) - np.arctan2(-A3 * np.sin(elbow), -A2 - A3 * cosine)
    return base, shoulder, elbow


def _elbow_cosine(forward: Any, height: Any) -> Any:
    """Cosine of the elbow angle for a wrist position from the shoulder (m), law of cosines; above 1: no solution."""
    return (forward * forward + height * height - (A2**2 + A3**2)) / (2 * A2 * A3)


def _round_to_full_turns(angles: FloatArray) -> FloatArray:
    """Nearest multiples of a full turn."""
    return TURN * np.rint(angles / TURN)


def _solve_ik_branch(flange: FloatArray, tool: FloatArray, signs: tuple[float, ...]) -> FloatArray:
    """A branch of the eight solutions for flange positions (N, 3) and tool rotations (N, 3, 3); NaN without any."""
    shoulder, flip, elbow = signs
    wrist = flange - D6 * tool[:, :, 2]
    with np.errstate(invalid="ignore", divide="ignore"):
        q1 = np.arctan2(wrist[:, 1], wrist[:, 0]) + np.pi / 2
        q1 += shoulder * np.arccos(D4 / np.hypot(wrist[:, 0], wrist[:, 1]))
        sin, cos = np.sin(q1), np.cos(q1)
        across = tool[:, 0] * sin[:, None] - tool[:, 1] * cos[:, None]  # the tool's axes along that of joint 2
        q5 = flip * np.arccos(np.clip(across[:, 2], -1.0, 1.0))
        side = np.sign(np.sin(q5))
        q6 = np.arctan2(-across[:, 1] * side, across[:, 0] * side)
        back = _joint_chain_transforms(np.column_stack([q5, q6]), 4)
        pose = np.zeros((len(flange), 4, 4))
        pose[:, :3, :3], pose[:, :3, 3], pose[:, 3, 3] = tool, flange, 1.0
        arm = np.linalg.inv(_joint_chain_transforms(q1[:, None], 0)) @ pose @ np.linalg.inv(back)
        reach = arm[:, :3, 3] - D4 * arm[:, :3, 1]
        length = np.hypot(reach[:, 0], reach[:, 1])
        q3 = elbow * np.arccos((length**2 - A2**2 - A3**2) / (2 * A2 * A3))
        q2 = np.arctan2(-reach[:, 1], -reach[:, 0]) - np.arcsin(-A3 * np.sin(q3) / length)
        ahead = np.linalg.inv(_joint_chain_transforms(np.column_stack([q2, q3]), 1)) @ arm
        q4 = np.arctan2(ahead[:, 1, 0], ahead[:, 0, 0])
    return np.column_stack([q1, q2, q3, q4, q5, q6])


def _joint_chain_transforms(angles: FloatArray, first: int) -> FloatArray:
    """Transforms (N, 4, 4) along joints (N, K), the first of them number ``first``."""
    frame = np.broadcast_to(np.eye(4), (len(angles), 4, 4))
    for column in range(angles.shape[1]):
        a, d, alpha = LINKS[first + column]
        ct, st = np.cos(angles[:, column]), np.sin(angles[:, column])
        ca, sa = float(np.cos(alpha)), float(np.sin(alpha))
        link = np.zeros((len(angles), 4, 4))
        link[:, 0] = np.stack([ct, -st * ca, st * sa, a * ct], axis=1)
        link[:, 1] = np.stack([st, ct * ca, -ct * sa, a * st], axis=1)
        link[:, 2], link[:, 3] = (0.0, sa, ca, d), (0.0, 0.0, 0.0, 1.0)
        frame = frame @ link
    return frame


_NAMES: Final = ("shoulder", "upper_arm", "forearm", "wrist_1", "wrist_2", "wrist_3")
_CAPSULES: Final[tuple[Capsule, ...]] = (
    ((0.0, 0.0, 0.02), (0.0, 0.0, D1), 0.060),
    ((0.0, 0.0, 0.138), (A2, 0.0, 0.138), 0.054),
    ((0.0, 0.0, 0.007), (A3, 0.0, 0.007), 0.042),
    ((0.0, 0.0, 0.02), (0.0, 0.0, D4 - 0.02), 0.037),
    ((0.0, 0.0, 0.0), (0.0, 0.0, D5), 0.037),
    ((0.0, 0.0, 0.0), (0.0, 0.0, D6 - 0.02), 0.034),
)
_LINKS: Final = np.loadtxt(
    """
    3.761    0.0 -0.02561   0.00193 150 6000   7.0021e-3   6.48091e-3   6.57286e-3    7.3e-7  -1.053e-5 4.9994e-4
    8.058 0.2125      0.0   0.11336 150 6000 1.505885e-2 3.3388086e-1 3.3247207e-1   -5.4e-5    5.63e-6  -1.81e-6
    2.846   0.15      0.0    0.0265 150 4000  3.99632e-3  7.879254e-2   7.84851e-2 -1.365e-5 1.37272e-3   -6.6e-6
     1.37    0.0  -0.0018   0.01634  28 2000  1.65491e-3   1.35962e-3   1.26279e-3  -2.82e-6   -4.38e-6 1.0157e-4
      1.3    0.0   0.0018   0.01634  28 2000  1.35617e-3   1.27827e-3    9.6614e-4  -2.74e-6    4.44e-6 -5.048e-5
    0.365    0.0      0.0 -0.001159  28 1000   1.8694e-4    1.8908e-4    2.5756e-4      6e-8    -1.7e-7   -9.2e-7
    """.splitlines()
).tolist()
"""Data sheet of each link: mass (kg); its centre (m) in the Denavit-Hartenberg frame of the link; torque
(N m) and stiffness (N m/rad) of the joint; inertia about the centre, xx, yy, zz, xy, xz, yz (kg m^2)."""


_BIG, _MIDDLE, _SMALL = 0.058, 0.048, 0.0375
"""Radii of the housings at the shoulder, the elbow and the wrist, metres."""
_SIDE: Final = 0.138
"""Offset of the upper arm from the base's axis, metres."""
_LOOKS: Final = (
    *ring("world", (0.0, 0.0, 0.0), (0.0, 0.0, 0.018), 0.0745),
    *tube("world", (0.0, 0.0, 0.018), (0.0, 0.0, 0.06), _BIG),
    *ring("shoulder", (0.0, 0.0, 0.09), (0.0, 0.0, 0.1), _BIG + 0.002),
    *tube("shoulder", (0.0, 0.0, 0.1), (0.0, 0.0, D1), _BIG),
    *housing("shoulder", (0.0, 0.062, D1), (0.0, -0.072, D1), _BIG, "start"),
    *ring("upper_arm", (0.0, 0.0, 0.072), (0.0, 0.0, 0.08), _BIG + 0.002),
    *housing("upper_arm", (0.0, 0.0, 0.08), (0.0, 0.0, _SIDE + 0.06), _BIG, "end"),
    *tube("upper_arm", (0.0, 0.0, _SIDE), (A2, 0.0, _SIDE), 0.045),
    *housing("upper_arm", (A2, 0.0, 0.08), (A2, 0.0, _SIDE + 0.05), _MIDDLE, "end"),
    *ring("forearm", (0.0, 0.0, 0.072), (0.0, 0.0, 0.08), _MIDDLE + 0.002),
    *housing("forearm", (0.0, 0.0, -0.045), (0.0, 0.0, 0.072), _MIDDLE, "start"),
    *tube("forearm", (0.0, 0.0, 0.007), (A3, 0.0, 0.007), _SMALL),
    *housing("forearm", (A3, 0.0, -0.036), (A3, 0.0, 0.05), _SMALL, "start"),
    *ring("wrist_1", (0.0, 0.0, 0.05), (0.0, 0.0, 0.056), _SMALL + 0.002),
    *tube("wrist_1", (0.0, 0.0, 0.06), (0.0, 0.0, D4), _SMALL),
    *housing("wrist_1", (0.0, 0.045, D4), (0.0, -0.045, D4), _SMALL, "start"),
    *ring("wrist_2", (0.0, 0.0, 0.045), (0.0, 0.0, 0.051), _SMALL + 0.002),
    *tube("wrist_2", (0.0, 0.0, 0.06), (0.0, 0.0, D5), _SMALL),
    *housing("wrist_2", (0.0, -0.045, D5), (0.0, 0.045, D5), _SMALL, "start"),
    *ring("wrist_3", (0.0, 0.0, 0.045), (0.0, 0.0, 0.051), _SMALL + 0.002),
    *housing("wrist_3", (0.0, 0.0, 0.051), (0.0, 0.0, D6 - 0.014), _SMALL, ""),
    *ring("wrist_3", (0.0, 0.0, D6 - 0.014), (0.0, 0.0, D6), 0.0315),
    *ring(MOUNT, (0.0, 0.0, 0.0), (0.0, 0.0, 0.012), 0.02),
)
"""Along the published frames: footprint 149 mm, flange 63 mm, wrists 75 mm across."""


class UR5e(Arm):
    """Universal Robots' UR5e."""

    looks = _LOOKS
    nearest, farthest = NEAREST, REACH
    solves_rows_alone = True
    maker_speeds = np.full(6, np.pi)  # 180 degrees a second each, by the maker's data sheet

    def __init__(self, hand: Hand = SUCTION_CUP) -> None:
        links: list[Link] = []
        position, roll = (0.0, 0.0, 0.0), 0.0
        for index, (a, d, alpha) in enumerate(LINKS):
            cos, sin = float(np.cos(alpha)), float(np.sin(alpha))
            turn = np.array([[1.0, 0.0, 0.0], [0.0, cos, -sin], [0.0, sin, cos]])
            mass, *center, torque, stiffness, xx, yy, zz, xy, xz, yz = _LINKS[index]
            x, y, z = np.array([a, 0.0, d]) + turn @ np.asarray(center)
            tensor = turn @ np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]) @ turn.T
            half = np.pi if index == 2 else TURN
            links.append(
                Link(
                    name=_NAMES[index],
                    position=position,
                    roll=roll,
                    limits=(-half, half),
                    torque=torque,
                    stiffness=stiffness,
                    mass=mass,
                    center=(float(x), float(y), float(z)),
                    inertia=(*np.diag(tensor).tolist(), float(tensor[0, 1]), float(tensor[0, 2]), float(tensor[1, 2])),
                    capsules=(_CAPSULES[index],),
                )
            )
            position, roll = (a, 0.0, d), alpha

        def add(spec: Any, moving: bool) -> None:
            add_link_chain(spec, links, (0.0, 0.0, D6), hand, moving)

        super().__init__("ur5e", add, solve_ik_tool_down(np.array([HOME]), np.zeros(1), hand.length)[0], hand)

    def solve_ik_tool_down(self, tips: FloatArray, yaws: FloatArray, seed: FloatArray | None = None) -> FloatArray:
        """As ``Arm.solve_ik_tool_down``, in closed form."""
        joints = solve_ik_tool_down(tips, yaws, self.hand.length)
        if seed is not None:
            ahead = (float(seed[5]) - float(joints[0, 5])) / TURN
            joints[:, 5] += TURN * round(ahead) if math.isfinite(ahead) else np.nan
        if not float(np.abs(joints).max()) <= TURN:  # or NaN
            joints[~(np.abs(joints).max(axis=1) <= TURN)] = np.nan
        return joints

    def tip_poses(self, path: FloatArray) -> tuple[FloatArray, FloatArray]:
        """As ``Arm.tip_poses``, in closed form if the tool points straight down all along."""
        base, shoulder, elbow, wrist, half, turn = path.T
        lean, right = shoulder + elbow + wrist + np.pi / 2, half + np.pi / 2
        if float(np.abs(lean).max()) > _DOWN or float(np.abs(right).max()) > _DOWN:
            return super().tip_poses(path)
        forward = D5 - A2 * np.cos(shoulder) - A3 * np.cos(shoulder + elbow)
        sine, cosine = np.sin(base), np.cos(base)
        tips = np.empty((len(path), 3))
        # The arm's plane lies ``D4`` beside the base's axis; it extends along minus x of link 1.
        tips[:, 0], tips[:, 1] = D4 * sine - forward * cosine, -D4 * cosine - forward * sine
        tips[:, 2] = D1 - D6 - self.hand.length + A2 * np.sin(shoulder) + A3 * np.sin(shoulder + elbow)
        return tips, rotations_about_z(base + np.pi / 2 - turn)

    def solve_ik_for_poses(self, tips: FloatArray, rotations: FloatArray, seed: FloatArray | None = None) -> FloatArray:
        """As ``Arm.solve_ik_for_poses``, in closed form: all rows on the branch, of eight, that is nearest ``seed``."""
        if seed is None:
            seed = self.home_joints
        tool = rotations @ DOWN
        flange = tips - self.hand.length * tool[:, :, 2]
        best, nearest = np.full((len(tips), 6), np.nan), np.inf
        for signs in product((1.0, -1.0), repeat=3):
            angles = _solve_ik_branch(flange, tool, signs)
            if not np.isfinite(angles).all():
                continue
            joints = angles + _round_to_full_turns(seed - angles[0])
            joints[1:] -= np.cumsum(_round_to_full_turns(np.diff(angles, axis=0)), axis=0)
            joints[:, 2] -= _round_to_full_turns(joints[:1, 2])
            limits = np.array([TURN, TURN, np.pi, TURN, TURN, TURN])
            distance = float(np.abs(joints[0] - seed).max())
            if distance < nearest and (np.abs(joints) <= limits).all():
                best, nearest = joints, distance
        return best

    def reachable_mask(self, tips: FloatArray) -> npt.NDArray[np.bool_]:
        """As ``Arm.reachable_mask``, in closed form, within the nominal reach."""
        radius = np.hypot(tips[:, 0], tips[:, 1])
        inside = (radius >= NEAREST) & (radius <= REACH)
        forward = np.sqrt(np.maximum(radius**2 - D4**2, 0.0)) - D5
        height = tips[:, 2] + self.hand.length + D6 - D1
        # Low and near the base the forearm's end would meet the shoulder: it must stay beside it or above it.
        inside &= (forward >= _SHOULDER) | (height >= _SHOULDER)
        return inside & (np.abs(_elbow_cosine(forward, height)) <= 1)
