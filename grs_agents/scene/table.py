"""Find the table in a frame and lay the robot frame on it."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from grs_agents.errors import InputError
from grs_agents.scene.frame import Array, Camera, RGBDFrame
from grs_agents.scene.types import TableFrame

Index = npt.NDArray[np.intp]
BEHIND = 0.001
"""What is not at least so far in front of the camera (m) is taken to be so far."""
SAMPLES = 12_000
ROUNDS = 400
LEAST_SHARE = 0.12
"""A table plane must hold at least this share of the measured pixels."""
LOWEST_TILT = np.deg2rad(12.0)
"""The camera looks down on the table by at least this angle."""
UNDER = 0.1
"""A table hides what is under it: points less than this (m) under a plane speak against it."""
HORIZONTAL = np.cos(np.deg2rad(12.0))
"""A calibrated table's normal is within 12 degrees of the robot's z axis."""


HIGHEST = 0.2
"""A calibrated table top lies within this height (m) of the robot frame's z = 0."""


@dataclass(frozen=True)
class Plane:
    """``normal @ point + offset = 0`` with the unit normal towards the camera."""

    normal: Array
    offset: float
    residual: float
    inliers: float


def tolerance(distance: Array) -> Array:
    """How far a depth pixel may be off its plane: sensors are worse with the square of the distance (m)."""
    return 0.005 + 0.003 * distance**2


def find_table(frame: RGBDFrame, rng: np.random.Generator) -> TableFrame:
    """Find the support plane by RANSAC, refined by least squares.

    With ``T_robot_cam`` the robot frame is the given one, moved along z so that the table top is z = 0. Without it the
    frame is laid on the plane: z up, x along the camera's view, y to the left; the origin is below the camera until
    `place_robot` moves it.

    Raises:
        InputError: no plane that the camera looks down on holds enough of the pixels.
    """
    rows, columns = np.nonzero(frame.depth > 0)
    picked = rng.choice(len(rows), size=min(SAMPLES, len(rows)), replace=False)
    sample = _points_at(frame, rows[picked], columns[picked])
    given = None if frame.camera.T_robot_cam is None else np.asarray(frame.camera.T_robot_cam, dtype=np.float64)
    up = None if given is None else given[:3, :3].T @ np.array([0.0, 0.0, 1.0])
    plane = _support_plane(sample, up, rng)
    if plane is None:
        raise InputError(
            f"{frame.source}: found no table plane with at least {LEAST_SHARE:.0%} of the measured pixels",
            "take the photo so that the table fills more of it and the camera looks down on it",
        )
    if given is None:
        return _laid(plane)
    table = _calibrated(plane, given)
    if abs(table.height) > HIGHEST:
        raise InputError(
            f"{frame.source / 'camera.json'}: T_robot_cam puts the table top at z = {table.height:+.3f} m, "
            f"more than {HIGHEST} m from the robot frame's z = 0",
            f"correct T_robot_cam, or depth_scale {frame.camera.depth_scale:g}; or leave T_robot_cam out",
        )
    return table


def _support_plane(points: Array, up: Array | None, rng: np.random.Generator) -> Plane | None:
    bound = tolerance(points[:, 2])
    best, normal, offset = 0, np.zeros(3), 0.0
    for unit, through in zip(*_hypotheses(points, up, rng), strict=True):
        distance = points @ unit - through
        count = np.count_nonzero(np.abs(distance) < bound / 2)
        if count > best:
            count -= np.count_nonzero((distance < -bound) & (distance > -UNDER))
        if count > best:
            best, normal, offset = count, unit, float(-through)
    if best <= 0:
        return None
    for _ in range(5):
        near = points.compress(np.abs(points @ normal + offset) < bound, axis=0)
        center = near.mean(axis=0)
        unit = np.linalg.svd(near - center, full_matrices=False)[2][2]
        normal = unit * (-1.0 if unit @ center > 0 else 1.0)
        offset = float(-normal @ center)
    distance = points @ normal + offset
    within = np.abs(distance) < bound
    if within.mean() < LEAST_SHARE:
        return None
    return Plane(normal, offset, float(np.sqrt(np.mean(distance[within] ** 2))), float(within.mean()))


def _hypotheses(points: Array, up: Array | None, rng: np.random.Generator) -> tuple[Array, Array]:
    """Planes through three points each: (N, 3) unit normals towards the camera, and (N,) products with their points.

    The camera looks down on each of them and is not upside down; a calibrated table is level.
    """
    picked = np.stack([rng.choice(len(points), size=3, replace=False) for _ in range(ROUNDS)])
    a, b, c = points[picked.T]
    crosses = np.cross(b - a, c - a)
    lengths = np.linalg.norm(crosses, axis=1)
    toward = np.where((crosses * a).sum(axis=1) > 0, -1.0, 1.0)
    units = crosses / np.maximum(lengths, 1e-12)[:, None] * toward[:, None]
    if up is not None:
        plausible = units @ up > HORIZONTAL
    else:
        plausible = (-units[:, 2] > np.sin(LOWEST_TILT)) & (units[:, 1] < 0.3)
    kept = plausible & (lengths >= 1e-5)
    return units[kept], (units * a).sum(axis=1)[kept]


def _laid(plane: Plane) -> TableFrame:
    z = plane.normal
    view = np.array([0.0, 0.0, 1.0]) - z * z[2]
    if np.linalg.norm(view) < 0.1:  # straight from above: the picture's upper edge is ahead
        view = np.array([0.0, -1.0, 0.0]) - z * -z[1]
    x = view / np.linalg.norm(view)
    rotation = np.stack([x, np.cross(z, x), z])
    transform = np.eye(4)
    transform[:3, :3] = rotation
    transform[2, 3] = plane.offset
    return TableFrame(
        T_robot_cam=as_matrix(transform),
        origin="table_plane",
        residual=plane.residual,
        inliers=plane.inliers,
        note="no T_robot_cam given: the robot frame is laid on the table found in the photo",
    )


def _calibrated(plane: Plane, given: Array) -> TableFrame:
    point = -plane.normal * plane.offset
    height = float((given[:3, :3] @ point + given[:3, 3])[2])
    moved = given.copy()
    moved[2, 3] -= height
    note = f"the table top lies at z = {height:+.3f} m of the calibrated frame" if abs(height) > 0.005 else ""
    return TableFrame(
        T_robot_cam=as_matrix(moved),
        origin="calibrated",
        residual=plane.residual,
        inliers=plane.inliers,
        height=height,
        note=note,
    )


def as_matrix(transform: Array) -> tuple[tuple[float, ...], ...]:
    """A 4x4 array as nested tuples of floats."""
    return tuple(tuple(float(value) for value in row) for row in transform)


def _points_at(frame: RGBDFrame, rows: Index, columns: Index) -> Array:
    """(N, 3) points of N pixels in the camera frame, metres."""
    camera, z = frame.camera, frame.depth[rows, columns].astype(np.float64)
    return np.stack([(columns - camera.cx) / camera.fx * z, (rows - camera.cy) / camera.fy * z, z], axis=-1)


def robot_points_at(frame: RGBDFrame, table: TableFrame, rows: Index, columns: Index) -> Array:
    """(N, 3) points of N measured pixels in the robot frame, metres."""
    transform = np.asarray(table.T_robot_cam)
    return _points_at(frame, rows, columns) @ transform[:3, :3].T + transform[:3, 3]


def robot_points(frame: RGBDFrame, table: TableFrame) -> Array:
    """(H, W, 3) points in the robot frame, metres; NaN where there is no depth."""
    transform = np.asarray(table.T_robot_cam)
    points = frame.points() @ transform[:3, :3].T
    points += transform[:3, 3]
    points[frame.depth <= 0] = np.nan
    return points


def projected(points: Array, camera: Camera, table: TableFrame) -> tuple[Array, Array, Array]:
    """Columns, rows (pixels, not rounded) and depth (m) of (N, 3) points, m, robot frame; at least `BEHIND` deep."""
    transform = np.asarray(table.T_robot_cam)
    x, y, z = ((points - transform[:3, 3]) @ transform[:3, :3]).T
    depth = np.maximum(z, BEHIND)
    return x / depth * camera.fx + camera.cx, y / depth * camera.fy + camera.cy, depth
