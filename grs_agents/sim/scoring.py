"""How far goals are met, as published with CLIPort: z and tilt do not count."""

import numpy as np
import numpy.typing as npt

from grs_agents.base import Pose
from grs_agents.library import ObjectModel, Shape
from grs_agents.sim import utils
from grs_agents.sim.geometry import per_model
from grs_agents.sim.goals import Goal, Zone
from grs_agents.sim.instance import POSITION_TOLERANCE, ROTATION_TOLERANCE

FloatArray = npt.NDArray[np.float64]


def angle_between(first: float, second: float, symmetry: float) -> float:
    """The smallest turn (rad) that aligns two yaws of something that repeats every ``symmetry``; 0 = any yaw."""
    if symmetry <= 0:
        return 0.0
    difference = abs(first - second) % symmetry
    return float(min(difference, symmetry - difference))


def pose_matches(
    pose: Pose, target: Pose, symmetry: float,
    pos_eps: float = POSITION_TOLERANCE, rot_eps: float = ROTATION_TOLERANCE,
) -> bool:  # fmt: skip
    """Whether ``pose`` is at ``target``: xy within ``pos_eps`` metres, yaw within ``rot_eps`` radians."""
    distance = float(np.hypot(pose[0][0] - target[0][0], pose[0][1] - target[0][1]))
    turn = angle_between(utils.yaw_of(pose[1]), utils.yaw_of(target[1]), symmetry)
    return distance < pos_eps and turn < rot_eps


def _shape_samples(shape: Shape, bounds: tuple[FloatArray, FloatArray]) -> FloatArray:
    steps = np.linspace(-0.5, 0.5, 5)
    if shape.kind == "mesh":
        low, high = bounds
        grid = np.array(np.meshgrid(steps, steps, steps, indexing="ij")).reshape(3, -1)
        return (low + high)[:, None] / 2 + (high - low)[:, None] * grid
    if shape.kind == "box":
        points = np.array(np.meshgrid(steps, steps, steps, indexing="ij")).reshape(3, -1)
        points = points * np.asarray(shape.size)[:, None]
    else:
        angle = np.arange(12) * (np.pi / 6)
        radius, length = shape.size[0], shape.size[1] if shape.kind == "cylinder" else 2 * shape.size[0]
        rings = [
            np.stack([r * np.cos(angle), r * np.sin(angle), np.full(12, z * length)])
            for r in (radius / 3, 2 * radius / 3, radius)
            for z in steps
            if shape.kind == "cylinder" or np.hypot(r, z * length) <= radius + 1e-9
        ]
        points = np.hstack(rings)
    return utils.apply((shape.position, shape.quaternion), points)


@per_model
def volume_points(model: ObjectModel) -> FloatArray:
    """Points (3, N) spread over an object's collision volume, object frame."""
    bounds = (np.asarray(model.bounds[0]), np.asarray(model.bounds[1]))
    shapes = [_shape_samples(shape, bounds) for shape in model.colliders]
    return np.hstack(shapes) if shapes else np.zeros((3, 1))


def share_inside(model: ObjectModel, pose: Pose, zones: list[Zone], ceiling: float) -> float:
    """The share of an object's volume that lies over any of the zones and below ``ceiling`` (m)."""
    points = utils.apply(pose, volume_points(model))
    inside = np.zeros(points.shape[1], dtype=bool)
    for zone_pose, size in zones:
        local = utils.apply(utils.invert(zone_pose), points)
        inside |= (np.abs(local[0]) <= size[0] / 2) & (np.abs(local[1]) <= size[1] / 2)
    return float((inside & (points[2] < ceiling)).mean())


def object_scores(
    goal: Goal, poses: dict[int, Pose], models: dict[int, ObjectModel], ceiling: float,
    pos_eps: float = POSITION_TOLERANCE, rot_eps: float = ROTATION_TOLERANCE,
) -> list[float]:  # fmt: skip
    """For each object of the goal, how far (0..1) it is where it should be."""
    if goal.metric == "zone":
        return [share_inside(models[number], poses[number], goal.params, ceiling) for number in goal.objs]
    return [
        float(
            any(
                pose_matches(poses[number], goal.targ_poses[index], goal.symmetries[row], pos_eps, rot_eps)
                for index in np.flatnonzero(goal.matches[row])
            )
        )
        for row, number in enumerate(goal.objs)
    ]
