"""Tool paths: routes over the table, speed profiles, and smooth joint paths along them."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import accumulate, pairwise
from typing import Final

import numpy as np

from grs_agents.base import Quat, Vec3
from grs_agents.base.geometry import transforms
from grs_agents.base.geometry.transforms import FloatArray
from grs_agents.sim.arms.arm import Arm
from grs_agents.sim.arms.joint_paths import TURN_RADIUS, rotations_about_z, trapezoidal_profile
from grs_agents.sim.hands.hand import GRAVITY
from grs_agents.sim.hands.suction_cup import CUP, Nozzle
from grs_agents.sim.world.footprints import Prism, find_nearby_prisms, nearest_point_of_outline, signed_outline_gaps

_DETOURS: Final = (0.35, 0.45, 0.28, 0.55, 0.70)
_UPRIGHT: Final = 0.02
"""Smaller tilts count as upright, radians."""
_SHARE: Final = 0.5
"""Share of the cup's holding force and moment available to weight and motion: manufacturers ask for a twofold safety
factor in motion."""
_SLOWEST, _QUICKEST = 0.5, 12.0
"""Accelerations, m/s^2: granted even to a heavy load, and allowed by the torques of the joints (with 20 the arm leaves
its path)."""
_EASY, _RAMP = 8.0, 0.1
"""Largest acceleration (m/s^2) and shortest duration (s) of the ramps of a long path."""


@dataclass(frozen=True)
class ToolPose:
    """Pose of the tool: position of the tip (m), yaw about the vertical (rad), then tilt (rotation vector)."""

    point: Vec3
    yaw: float
    tilt: Vec3 = (0.0, 0.0, 0.0)

    def shifted_by(self, offset: FloatArray) -> "ToolPose":
        """The pose shifted by (3,) metres."""
        return ToolPose(transforms.to_vec3(np.asarray(self.point) + offset), self.yaw, self.tilt)


@dataclass(frozen=True)
class Pace:
    """Speed (m/s), acceleration (m/s^2) and sample time (s) of a motion; ``even``: constant speed from end to end."""

    speed: float
    acceleration: float
    timestep: float
    even: bool = False


@dataclass(frozen=True)
class Payload:
    """Load on a nozzle: mass (kg), and distances (m) of its centre from the tip, aside and along the tool."""

    mass: float
    aside: float
    below: float
    nozzle: Nozzle = CUP

    @property
    def would_peel_off_cup(self) -> bool:
        """Whether its weight, with the gentlest motion, peels it off the cup."""
        return self.mass * (GRAVITY * self.aside + _SLOWEST * (self.aside + self.below)) > self.nozzle.peeling_moment

    def safe_acceleration(self, level: float) -> float:
        """Acceleration that does not tear it off, m/s^2, on a path of which the share ``level`` is horizontal."""
        mass = max(self.mass, 1e-6)
        pulled = _SHARE * self.nozzle.holding_force / mass - GRAVITY
        moment = _SHARE * self.nozzle.peeling_moment / mass - GRAVITY * self.aside
        bent = moment / max(self.aside + level * self.below, 1e-3)
        return max(min(pulled, bent), _SLOWEST)


def choose_safe_pace(speed: float, burden: Payload | None, timestep: float, level: float = 1.0) -> Pace:
    """Pace at which the inertia of a load, if there is any, does not tear it off the cup."""
    return Pace(speed, _QUICKEST if burden is None else min(_QUICKEST, burden.safe_acceleration(level)), timestep)


def split_into_yaw_and_tilt(rotation: Quat) -> tuple[float, Vec3]:
    """Swing-twist decomposition: yaw about the vertical (rad), then a tilt about a level axis (rotation vector)."""
    _, _, z, w = rotation
    yaw = 2 * float(np.arctan2(z, w))
    yaw = float((yaw + np.pi) % (2 * np.pi) - np.pi)
    half = -yaw / 2
    swing = transforms.multiply_quaternions(rotation, (0.0, 0.0, float(np.sin(half)), float(np.cos(half))))
    vector = np.array(swing[:3]) * (1.0 if swing[3] >= 0 else -1.0)
    sine = float(np.linalg.norm(vector))
    angle = 2 * float(np.arctan2(sine, abs(swing[3])))
    return (yaw, (0.0, 0.0, 0.0)) if angle < _UPRIGHT else (yaw, transforms.to_vec3(vector / sine * angle))


def tool_up_axis(tilt: Vec3) -> FloatArray:
    """Unit vector (3,) out of the back of a tilted tool."""
    return rotations_from_rotvecs(np.array([tilt]))[0][:, 2]


def rotations_from_rotvecs(vectors: FloatArray) -> FloatArray:
    """Rotations (N, 3, 3) of rotation vectors (N, 3), by Rodrigues' formula."""
    angle = np.linalg.norm(vectors, axis=1)
    x, y, z = (vectors / np.maximum(angle, 1e-12)[:, None]).T
    zero = np.zeros_like(x)
    cross = np.array([[zero, -z, y], [z, zero, -x], [-y, x, zero]]).transpose(2, 0, 1)
    sin, cos = np.sin(angle)[:, None, None], np.cos(angle)[:, None, None]
    return np.eye(3) + sin * cross + (1 - cos) * (cross @ cross)


def polar_path(start: Vec3, end: Vec3, share: FloatArray) -> FloatArray:
    """Points (N, 3) at shares (N,) of a path from start to end, linear in polar coordinates about the base axis."""
    radius, angle = math.hypot(*start[:2]), math.atan2(start[1], start[0])
    r = radius + share * (math.hypot(*end[:2]) - radius)
    a = angle + share * (math.atan2(end[1], end[0]) - angle)
    return np.stack([r * np.cos(a), r * np.sin(a), start[2] + share * (end[2] - start[2])], axis=1)


def smoothstep(samples: int) -> FloatArray:
    """Quintic smoothstep: shares (samples,) of a path, 0..1, with zero speed and acceleration at both ends."""
    share = np.arange(samples, dtype=np.float64) / (samples - 1)
    return share * share * share * (10 - share * (15 - 6 * share))


_SAMPLES: Final = smoothstep(24)
"""Shares of a path at which obstacles are looked for."""


def motion_profile(length: float, gait: Pace) -> FloatArray:
    """Shares (N,) of a path of ``length`` metres, 0..1, per sample: smoothstep or trapezoid, whichever is faster."""
    if gait.even:
        seconds = length / gait.speed + _RAMP / 2
        return trapezoidal_profile(_count_samples(seconds, gait), min(0.5, _RAMP / 2 / seconds))
    smoothly = max(1.875 * length / gait.speed, float(np.sqrt(5.774 * length / gait.acceleration)))
    ramp = max(gait.speed / min(gait.acceleration, _EASY), _RAMP)
    fast = length / gait.speed + ramp
    if fast < smoothly and 2 * ramp < fast:
        return trapezoidal_profile(_count_samples(fast, gait), ramp / fast)
    return smoothstep(_count_samples(smoothly, gait))


def _count_samples(seconds: float, gait: Pace) -> int:
    """Number of samples of a motion that takes at least ``seconds``, both ends included."""
    return max(3, math.ceil(seconds / gait.timestep) + 1)


def plan_joint_legs(arm: Arm, poses: Sequence[ToolPose], gaits: Sequence[Pace], seed: FloatArray) -> list[FloatArray]:
    """Joint positions (N, dof) of each leg between two poses, at the samples of its pace.

    The first leg begins near ``seed``; the last is NaN if the arm cannot follow it.
    """
    shares: list[FloatArray] = []
    for (start, end), gait in zip(pairwise(poses), gaits, strict=True):
        turning = abs(end.yaw - start.yaw) + math.dist(start.tilt, end.tilt)
        shares.append(motion_profile(math.dist(start.point, end.point) + TURN_RADIUS * turning, gait))
    ends = list(accumulate(map(len, shares)))
    points, yaws = interpolate_upright(poses, shares)
    if arm.solves_rows_alone and not any(any(pose.tilt) for pose in poses):
        joints = arm.solve_ik_tool_down(points, yaws, seed)
        return [joints[start:end] for start, end in pairwise((0, *ends))]
    solved: list[FloatArray] = []
    for leg, (start, end) in enumerate(pairwise((0, *ends))):
        tilts = np.array([pose.tilt for pose in poses[leg : leg + 2]])
        leans = tilts[0] + shares[leg][:, None] * (tilts[1] - tilts[0])
        points_of_leg, yaws_of_leg = points[start:end], yaws[start:end]
        if leans.any():
            rotations = rotations_from_rotvecs(leans) @ rotations_about_z(yaws_of_leg)
            solved.append(arm.solve_ik_for_poses(points_of_leg, rotations, seed))
        else:
            solved.append(arm.solve_ik_tool_down(points_of_leg, yaws_of_leg, seed))
        seed = solved[-1][-1]
        if not np.isfinite(seed).all():
            break
    return solved


def interpolate_upright(poses: Sequence[ToolPose], shares: Sequence[FloatArray]) -> tuple[FloatArray, FloatArray]:
    """Tip positions (N, 3) and yaws (N,) on all legs between poses; see ``polar_path``."""
    stops = np.array([(math.hypot(x, y), math.atan2(y, x), z, pose.yaw) for pose in poses for x, y, z in (pose.point,)])
    counts = [len(share) for share in shares]
    gone = np.concatenate(shares) * (stops[1:] - stops[:-1]).T.repeat(counts, axis=1)
    r, a, z, yaws = gone + stops[:-1].T.repeat(counts, axis=1)
    return np.stack([r * np.cos(a), r * np.sin(a), z], axis=1), yaws


def max_obstacle_height_along(start: Vec3, end: Vec3, radius: float, obstacles: Sequence[Prism]) -> float:
    """Top of the highest obstacle within ``radius`` of the path from start to end, metres."""
    if not obstacles:
        return 0.0
    x, y = polar_path(start, end, _SAMPLES)[:, :2].T
    x0, y0, x1, y1 = np.array([obstacle.bounding_box_xy for obstacle in obstacles]).T[:, :, None]
    aside, along = np.maximum(np.maximum(x0 - x, x - x1), 0.0), np.maximum(np.maximum(y0 - y, y - y1), 0.0)
    near = (aside * aside + along * along).min(axis=1) < radius * radius
    return max((obstacle.high for obstacle, hit in zip(obstacles, near.tolist(), strict=True) if hit), default=0.0)


def candidate_routes(start: Vec3, end: Vec3) -> Iterator[list[Vec3]]:
    """Routes over the table: straight first, then along circles around the base."""
    yield [start, end]
    sides = (math.atan2(start[1], start[0]), math.atan2(end[1], end[0]))
    for radius in _DETOURS:
        corners = [(radius * math.cos(angle), radius * math.sin(angle), start[2]) for angle in sides]
        yield [start, *corners, end]


_RUBBING, UNDER = 0.01, 0.005
"""A neighbour rubs against an object if it is closer to its side than the first, and rises higher than the second over
its underside, metres."""


def measure_touching_neighbours(number: int, obstacles: Sequence[Prism]) -> list[tuple[float, FloatArray]]:
    """Height (m) of each touching neighbour over an object's underside, and the horizontal direction (3,) from it."""
    others = [other for other in obstacles if other.owner != number]
    touching: list[tuple[float, FloatArray]] = []
    for part in (obstacle for obstacle in obstacles if obstacle.owner == number):
        for other in find_nearby_prisms(part, others, (0.0, 0.0), _RUBBING):
            gap = signed_outline_gaps(part.outline, other.outline, np.zeros((1, 2)))[0]
            if other.high > part.low + UNDER and gap < _RUBBING:
                center = part.outline.mean(axis=0)
                away = center - nearest_point_of_outline(other.outline, center)
                direction = np.array([*away / max(float(np.linalg.norm(away)), 1e-9), 0.0])
                touching.append((other.high - part.low, direction))
    return touching


def average_direction_if_compatible(directions: Sequence[FloatArray]) -> FloatArray:
    """Mean direction (3,) of unit vectors; zero if any of them points against it."""
    total = np.sum(directions, axis=0)
    common = total / max(float(np.linalg.norm(total)), 1e-9)
    return common if min(float(common @ direction) for direction in directions) > 0 else np.zeros(3)
