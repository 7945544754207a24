"""How far the arm keeps from the table and from its own base, for any joint angles."""

from typing import Final

import numpy as np
import numpy.typing as npt

from grs_agents.sim.kinematics import D1, TOOL_LENGTH, joint_frames
from grs_agents.sim.robot import CAPSULES, CUP_RADIUS

FloatArray = npt.NDArray[np.float64]
_SHARES: Final = np.linspace(0.0, 1.0, 7)
_BASE_RADIUS: Final = CAPSULES[0][2]
_MOVING: Final = range(2, 6)
"""Links that can come near the table or the base: forearm and wrists; the upper arm starts at the base."""


def _link_points(joints: FloatArray) -> list[tuple[FloatArray, float]]:
    """Points (7, 3) along the axis of each moving link, and its radius, metres; the tool comes last."""
    frames = [np.eye(4), *joint_frames(joints)]
    found: list[tuple[FloatArray, float]] = []
    for index in _MOVING:
        start, end, radius = CAPSULES[index]
        cos, sin = float(np.cos(joints[index])), float(np.sin(joints[index]))
        turn = np.array([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]])
        local = np.outer(1 - _SHARES, start) + np.outer(_SHARES, end)
        frame = frames[index]
        found.append((local @ (frame[:3, :3] @ turn).T + frame[:3, 3], radius))
    flange = frames[-1]
    found.append((flange[:3, 3] + np.outer(_SHARES * TOOL_LENGTH, flange[:3, 2]), CUP_RADIUS))
    return found


def clearance(joints: FloatArray) -> float:
    """The smallest gap (m) between the arm and the table top, or its own base; negative where it would hit.

    Args:
        joints: angles (6,), radians.
    """
    gaps: list[float] = []
    for index, (points, radius) in enumerate(_link_points(joints)):
        tool = index == len(_MOVING)
        gaps.append(float(points[:, 2].min()) - (0.0 if tool else radius))
        aside = np.hypot(points[:, 0], points[:, 1]) - _BASE_RADIUS - radius
        above = points[:, 2] - D1 - _BASE_RADIUS - radius
        gaps.append(float(np.maximum(aside, above).min()))
    return min(gaps)


def along(path: FloatArray, samples: int = 24) -> float:
    """The smallest clearance (m) along joint angles (N, 6)."""
    rows = np.unique(np.linspace(0, len(path) - 1, samples).astype(int))
    return min(clearance(path[row]) for row in rows)
