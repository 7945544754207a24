"""Stretches of the tool's way: routes over the table, and smooth joint paths along them."""

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
from grs_agents.sim.arms.joint_paths import rotations_about_z, trapezoidal_profile
from grs_agents.sim.world.footprints import Prism, find_nearby_prisms, nearest_point_of_outline, signed_outline_gaps
from grs_agents.sim.world.nozzles import CUP, Nozzle
from grs_agents.sim.world.suction import GRAVITY

_DETOURS: Final = (0.35, 0.45, 0.28, 0.55, 0.70)
_UPRIGHT: Final = 0.02
"""Tilts below this are none, radians."""
_SHARE: Final = 0.5
"""How much of the cup's holding force and of its moment weight and motion may use: cups' makers ask for twofold safety
where things move."""
_SLOWEST, _QUICKEST = 0.5, 12.0
"""Metres a second squared: what a heavy thing gets all the same, and what the joints' torques allow: with 20 the arm
leaves its path."""
_EASY, _RAMP = 8.0, 0.1
"""Metres a second squared at most, and seconds at least, in which a long way reaches its speed."""


@dataclass(frozen=True)
class ToolPose:
    """Where the tip is (m), how the tool is turned about the vertical (rad) and then tilted (rotation vector)."""

    point: Vec3
    yaw: float
    tilt: Vec3 = (0.0, 0.0, 0.0)

    def shifted_by(self, offset: FloatArray) -> "ToolPose":
        """The pose shifted by (3,) metres."""
        return ToolPose(transforms.to_vec3(np.asarray(self.point) + offset), self.yaw, self.tilt)


@dataclass(frozen=True)
class Pace:
    """Speed (m/s), acceleration (m/s^2) and time (s) from sample to sample of a motion; ``even``: at that speed from
    end to end."""

    speed: float
    acceleration: float
    timestep: float
    even: bool = False


@dataclass(frozen=True)
class Payload:
    """What is on a nozzle: its mass (kg), and how far (m) its centre is from the tip, aside and along the tool."""

    mass: float
    aside: float
    below: float
    nozzle: Nozzle = CUP

    @property
    def would_peel_off_cup(self) -> bool:
        """Whether its weight, with the gentlest motion, bends it off the cup."""
        return self.mass * (GRAVITY * self.aside + _SLOWEST * (self.aside + self.below)) > self.nozzle.peeling_moment

    def safe_acceleration(self, level: float) -> float:
        """What its inertia stands without tearing it off, m/s^2, on a way of which a share ``level`` is level."""
        mass = max(self.mass, 1e-6)
        pulled = _SHARE * self.nozzle.holding_force / mass - GRAVITY
        moment = _SHARE * self.nozzle.peeling_moment / mass - GRAVITY * self.aside
        bent = moment / max(self.aside + level * self.below, 1e-3)
        return max(min(pulled, bent), _SLOWEST)


def choose_safe_pace(speed: float, burden: Payload | None, timestep: float, level: float = 1.0) -> Pace:
    """How to move with something on the cup, or nothing, so that its own inertia does not tear it off."""
    return Pace(speed, _QUICKEST if burden is None else min(_QUICKEST, burden.safe_acceleration(level)), timestep)


def split_into_yaw_and_tilt(rotation: Quat) -> tuple[float, Vec3]:
    """A rotation as a turn about the vertical (rad, nearest zero), then a tilt about a level axis (rotation vector)."""
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
    """The unit vector (3,) out of the back of a tool that is tilted."""
    return rotations_from_rotvecs(np.array([tilt]))[0][:, 2]


def rotations_from_rotvecs(vectors: FloatArray) -> FloatArray:
    """The rotations (N, 3, 3) of rotation vectors (N, 3)."""
    angle = np.linalg.norm(vectors, axis=1)
    x, y, z = (vectors / np.maximum(angle, 1e-12)[:, None]).T
    zero = np.zeros_like(x)
    cross = np.array([[zero, -z, y], [z, zero, -x], [-y, x, zero]]).transpose(2, 0, 1)
    sin, cos = np.sin(angle)[:, None, None], np.cos(angle)[:, None, None]
    return np.eye(3) + sin * cross + (1 - cos) * (cross @ cross)


def polar_path(start: Vec3, end: Vec3, share: FloatArray) -> FloatArray:
    """Points (N, 3) at shares (N,) of the way from start to end; the distance from the base axis changes evenly."""
    radius, angle = math.hypot(*start[:2]), math.atan2(start[1], start[0])
    r = radius + share * (math.hypot(*end[:2]) - radius)
    a = angle + share * (math.atan2(end[1], end[0]) - angle)
    return np.stack([r * np.cos(a), r * np.sin(a), start[2] + share * (end[2] - start[2])], axis=1)


def smoothstep(samples: int) -> FloatArray:
    """Shares (samples,) of a way, 0..1, that begin and end without speed or acceleration."""
    share = np.arange(samples, dtype=np.float64) / (samples - 1)
    return share * share * share * (10 - share * (15 - 6 * share))


_SAMPLES: Final = smoothstep(24)
"""Where on a way obstacles are looked for."""


def motion_profile(length: float, gait: Pace) -> FloatArray:
    """Shares (N,) of a way of ``length`` metres, 0..1, one a sample: the sooner there of two ways to go.
    A short way begins and ends as smoothly as its time allows; a long one goes at full speed between two ramps."""
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
    """How many there are from the beginning to the end of a motion that takes no less than ``seconds``."""
    return max(3, math.ceil(seconds / gait.timestep) + 1)


def plan_joint_legs(arm: Arm, poses: Sequence[ToolPose], gaits: Sequence[Pace], seed: FloatArray) -> list[FloatArray]:
    """Joint positions (N, dof) of each stretch between two of the poses, in the paces' times: the first begins near
    ``seed``, the last is NaN where the arm cannot."""
    shares = [_share_of_way(start, end, gait) for (start, end), gait in zip(pairwise(poses), gaits, strict=True)]
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


def _share_of_way(start: ToolPose, end: ToolPose, gait: Pace) -> FloatArray:
    """Which share (N,) of the way between two poses is gone, in the pace's times."""
    turning = abs(end.yaw - start.yaw) + math.dist(start.tilt, end.tilt)
    return motion_profile(math.dist(start.point, end.point) + 0.25 * turning, gait)


def interpolate_upright(poses: Sequence[ToolPose], shares: Sequence[FloatArray]) -> tuple[FloatArray, FloatArray]:
    """Where the tip is (N, 3) and how the tool is turned (N,) on all stretches between poses; see ``polar_path``."""
    stops = np.array([(math.hypot(x, y), math.atan2(y, x), z, pose.yaw) for pose in poses for x, y, z in (pose.point,)])
    counts = [len(share) for share in shares]
    gone = np.concatenate(shares) * (stops[1:] - stops[:-1]).T.repeat(counts, axis=1)
    r, a, z, yaws = gone + stops[:-1].T.repeat(counts, axis=1)
    return np.stack([r * np.cos(a), r * np.sin(a), z], axis=1), yaws


def max_obstacle_height_along(start: Vec3, end: Vec3, radius: float, obstacles: Sequence[Prism]) -> float:
    """The top of the highest obstacle that comes within ``radius`` of the way from start to end."""
    if not obstacles:
        return 0.0
    x, y = polar_path(start, end, _SAMPLES)[:, :2].T
    x0, y0, x1, y1 = np.array([obstacle.bounding_box_xy for obstacle in obstacles]).T[:, :, None]
    aside, along = np.maximum(np.maximum(x0 - x, x - x1), 0.0), np.maximum(np.maximum(y0 - y, y - y1), 0.0)
    near = (aside * aside + along * along).min(axis=1) < radius * radius
    return max((obstacle.high for obstacle, one in zip(obstacles, near.tolist(), strict=True) if one), default=0.0)


def candidate_routes(start: Vec3, end: Vec3) -> Iterator[list[Vec3]]:
    """Ways over the table: straight first, then drawn in (or out) to a circle around the base and along it."""
    yield [start, end]
    sides = (math.atan2(start[1], start[0]), math.atan2(end[1], end[0]))
    for radius in _DETOURS:
        corners = [(radius * math.cos(angle), radius * math.sin(angle), start[2]) for angle in sides]
        yield [start, *corners, end]


_RUBBING, UNDER = 0.01, 0.005
"""Nearer to the side than the first, and higher than the second over an object's underside, a neighbour may rub against
it, metres."""


def measure_touching_neighbours(number: int, obstacles: Sequence[Prism]) -> list[tuple[float, FloatArray]]:
    """How high (m) over an object's underside each thing beside it reaches, and the level way (3,) from it."""
    others = [other for other in obstacles if other.owner != number]
    return [
        (other.high - part.low, _horizontal_direction_between_outlines(part, other))
        for part in obstacles
        if part.owner == number
        for other in find_nearby_prisms(part, others, (0.0, 0.0), _RUBBING)
        if other.high > part.low + UNDER
        and signed_outline_gaps(part.outline, other.outline, np.zeros((1, 2)))[0] < _RUBBING
    ]


def _horizontal_direction_between_outlines(part: Prism, other: Prism) -> FloatArray:
    """The level unit vector (3,) from one outline to another beside it."""
    center = part.outline.mean(axis=0)
    away = center - nearest_point_of_outline(other.outline, center)
    return np.array([*away / max(float(np.linalg.norm(away)), 1e-9), 0.0])


def average_direction_if_compatible(directions: Sequence[FloatArray]) -> FloatArray:
    """A unit vector (3,) that leads the way of all directions; none, (0, 0, 0), where one leads against another."""
    total = np.sum(directions, axis=0)
    common = total / max(float(np.linalg.norm(total)), 1e-9)
    return common if min(float(common @ direction) for direction in directions) > 0 else np.zeros(3)
