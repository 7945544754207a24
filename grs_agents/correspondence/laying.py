"""Lay an asset into a candidate's points from many turns at once, and tell how well it fits there."""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import numpy.typing as npt

from grs_agents.correspondence.appearance import Appearance
from grs_agents.correspondence.observation import Observation, View
from grs_agents.scene.frame import Array
from grs_agents.scene.points import Tree
from grs_agents.scene.symmetry import quarter_turns

Indices = npt.NDArray[np.int64]

FAR = 0.02
"""What is farther off than this (m) counts as this far."""
AIR = 0.008
"""A surface so far (m) before what was measured there stands in the air."""
KEPT = 8
"""So many of the turns are told of colours."""
_ROUNDS = 4
_TRIED = 14
_PROBES = 250
_RIDGE = (2e-3, 2e-3, 2e-3, 0.05, 0.05, 0.05)


@dataclass(frozen=True)
class Laid:
    """Poses of an asset, the best first.

    Attributes:
        poses: (K, 4, 4) asset frame (at the centre of its bounding box) to robot frame.
        off: (K,) how far the candidate's points are off the surface: mean, m.
        air: (K,) how far the surface that faces the camera stands before what was measured: mean, m.
    """

    poses: Array
    off: Array
    air: Array


def lay(asset: Appearance, tree: Tree, seen: Observation, view: View) -> Laid:
    """The poses in which the asset fits best."""
    poses = np.concatenate([_upright(asset, seen), _leaning(asset, seen, view)])
    begin = _off(asset, tree, poses, seen.points[::4])
    poses = poses[np.argsort(begin, kind="stable")[:_TRIED]]
    for _ in range(_ROUNDS):
        poses = _stepped(asset, tree, poses, seen.points[::2])
    off, air = _off(asset, tree, poses, seen.points), _air(asset, poses, view)
    best = np.argsort(off + 0.7 * air, kind="stable")[:KEPT]
    return Laid(poses[best], off[best], air[best])


def _upright(asset: Appearance, seen: Observation) -> Array:
    """Poses (K, 4, 4) on each of its sides, under the top that was measured, at some yaws."""
    quarter = np.stack(_turns(asset.round))
    yaws = [seen.upright.yaw + between for between in (0.0, np.pi / 6, -np.pi / 6)]
    extents = np.abs(quarter) @ asset.half
    poses = np.tile(np.eye(4), (len(yaws), len(quarter), 1, 1))
    poses[:, :, :3, :3] = np.stack([_about_z(yaw) for yaw in yaws])[:, None] @ quarter
    top = seen.upright.center[2] + seen.upright.size[2] / 2
    poses[:, :, :2, 3] = seen.upright.center[:2]
    poses[:, :, 2, 3] = np.maximum(top - extents[:, 2], extents[:, 2] - 0.01)
    return poses.reshape(-1, 4, 4)


def _leaning(asset: Appearance, seen: Observation, view: View) -> Array:
    """Poses (K, 4, 4) along the principal axes of the points, their near side where the points begin."""
    middle = seen.points.mean(axis=0)
    _, axes = np.linalg.eigh((seen.points - middle).T @ (seen.points - middle))
    axes = axes * np.where(axes.T @ (view.eye - middle) < 0, -1.0, 1.0)
    axes[:, 2] *= np.sign(np.linalg.det(axes))
    local = (seen.points - middle) @ axes
    low, high = np.percentile(local, (2, 98), axis=0)
    quarter = np.stack(_turns(asset.round))
    extents = np.abs(quarter) @ asset.half
    places = np.tile((low + high) / 2, (len(quarter), 1))
    places[:, 0] = high[0] - extents[:, 0]  # the flattest direction is the one that was seen head-on
    poses = np.tile(np.eye(4), (len(quarter), 1, 1))
    poses[:, :3, :3] = axes @ quarter
    poses[:, :3, 3] = places @ axes.T + middle
    return poses


@lru_cache(maxsize=4)
def _turns(axis: int) -> tuple[Array, ...]:
    """The quarter turns; of what is round about an axis one for each way that the axis points."""
    if axis < 0:
        return tuple(quarter_turns())
    found: dict[bytes, Array] = {}
    for turn in quarter_turns():
        found.setdefault(np.round(turn[:, axis]).tobytes(), turn)
    return tuple(found.values())


def _nearest(asset: Appearance, tree: Tree, poses: Array, points: Array) -> tuple[Array, Array, Array]:
    """For each pose (K) and point (N): its place in the asset's frame, the offset to the surface, the normal there."""
    local = (points - poses[:, None, :3, 3]) @ poses[:, :3, :3]
    nearest, _ = tree.nearest(local.reshape(-1, 3))
    shape = local.shape
    return local, (asset.points[nearest].reshape(shape) - local), asset.normals[nearest].reshape(shape)


def _off(asset: Appearance, tree: Tree, poses: Array, points: Array) -> Array:
    """(K,) mean distance of points from the surface, m."""
    _, offset, normals = _nearest(asset, tree, poses, points)
    across: Array = np.abs(np.einsum("kni,kni->kn", offset, normals))
    apart = np.linalg.norm(offset, axis=2)
    off = np.minimum(np.where(apart < 0.008, across, apart), FAR)
    return np.sort(off, axis=1)[:, : max(1, round(0.92 * len(points)))].mean(axis=1)


def _stepped(asset: Appearance, tree: Tree, poses: Array, points: Array) -> Array:
    """One step of point-to-plane alignment for all poses; what is far off has little weight."""
    local, offset, normals = _nearest(asset, tree, poses, points)
    apart = np.linalg.norm(offset, axis=2)
    weight = 1 / (1 + (apart / 0.01) ** 2)
    jacobian = np.concatenate([normals, np.cross(local, normals) / 0.05], axis=2)
    wanted = np.einsum("kni,kni->kn", offset, normals)
    left: Array = np.einsum("kn,kni,knj->kij", weight, jacobian, jacobian) / len(points) + np.diag(_RIDGE)
    right: Array = np.einsum("kn,kni,kn->ki", weight, jacobian, wanted) / len(points)
    step: Array = np.linalg.solve(left, right[:, :, None])[:, :, 0].astype(np.float64)
    moved = poses.copy()
    # the points move in the asset's frame by the step, so the asset moves by its inverse
    for number, (shift, turn) in enumerate(zip(step[:, :3], step[:, 3:] / 0.05, strict=True)):
        rotation = _rotation(turn)
        moved[number, :3, :3] = poses[number, :3, :3] @ rotation.T
        moved[number, :3, 3] = poses[number, :3, 3] - moved[number, :3, :3] @ shift
    return moved


def _air(asset: Appearance, poses: Array, view: View) -> Array:
    """(K,) how far the surface stands before what was measured, or below the table: mean, m."""
    points, normals = asset.points[:_PROBES], asset.normals[:_PROBES]
    placed = points @ poses[:, :3, :3].transpose(0, 2, 1) + poses[:, None, :3, 3]
    turned = normals @ poses[:, :3, :3].transpose(0, 2, 1)
    facing = np.einsum("kni,kni->kn", turned, placed - view.eye) < 0
    rows, columns, depth, inside = project(view, placed)
    measured = np.where(inside, view.frame.depth[rows, columns], 0.0)
    known = facing & (measured > 0)
    before = np.clip(measured - depth - AIR, 0, FAR) * known
    below = np.clip(-placed[:, :, 2] - 0.003, 0, FAR)
    return before.sum(axis=1) / np.maximum(known.sum(axis=1), 1) + below.mean(axis=1)


def project(view: View, placed: Array) -> tuple[Indices, Indices, Array, npt.NDArray[np.bool_]]:
    """Where points (K, N, 3) (m, robot frame) are in the picture: rows, columns, depth (m), and whether inside."""
    camera, pose = view.frame.camera, np.asarray(view.table.T_robot_cam)
    local = (placed - pose[:3, 3]) @ pose[:3, :3]
    depth = np.maximum(local[..., 2], 1e-3)
    columns = np.rint(local[..., 0] / depth * camera.fx + camera.cx).astype(np.int64)
    rows = np.rint(local[..., 1] / depth * camera.fy + camera.cy).astype(np.int64)
    height, width = view.frame.depth.shape
    inside = (columns >= 0) & (columns < width) & (rows >= 0) & (rows < height)
    return np.clip(rows, 0, height - 1), np.clip(columns, 0, width - 1), depth, inside


def _about_z(yaw: float) -> Array:
    return _rotation(np.array([0.0, 0.0, yaw]))


def _rotation(vector: Array) -> Array:
    """The rotation by a vector's length (rad) about it."""
    angle = float(np.linalg.norm(vector))
    if angle < 1e-9:
        return np.eye(3)
    x, y, z = vector / angle
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross
