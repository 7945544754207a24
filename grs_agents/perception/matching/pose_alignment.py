"""Align assets with a candidate's points from many turns at once, and tell how well each fits where it ends."""

from dataclasses import dataclass

import numpy as np

from grs_agents.perception.matching.asset_appearance import Appearance, Floats
from grs_agents.perception.matching.observation import Observation, View

FAR = np.float32(0.02)  # what is farther off than this (m) counts as this far
AIR = 0.008  # a surface so far (m) before what was measured there stands in the air
KEPT = 4  # so many of the poses are told of colours
_ROUNDS = 4
_TRIED = 10
_PROBES = 250
_NEAR = np.float32(0.008)
_TRIMMED = 0.92
_RIDGE = np.diag([2e-3, 2e-3, 2e-3, 0.05, 0.05, 0.05]).astype(np.float32)
_ARM = np.float32(0.05)  # a turn by one rad counts as a shift by this, m


@dataclass(frozen=True)
class AlignedPoses:
    """Poses of an asset, the best first."""

    # (K, 3, 3) rotations from the asset's frame (at the centre of its bounding box) to the robot frame
    rotations: Floats
    centers: Floats  # (K, 3) where that centre lies, m, robot frame
    residual: Floats  # (K,) how far the candidate's points are off the surface: mean, m
    free_space: Floats  # (K,) how far the surface that faces the camera stands before what was measured: mean, m
    height: Floats  # (K,) how far its lowest point is above the table, m

    @property
    def pose_costs(self) -> Floats:
        """(K,) m; less is better."""
        return self.residual + np.float32(0.7) * self.free_space


@dataclass(frozen=True)
class AlignmentStart:
    """From where assets begin to be aligned with a candidate; the same for all of them."""

    yaws: Floats  # (Y, 3, 3) turns about the vertical
    top: float  # how high it reaches, m
    flat: Floats  # (2, 2) horizontal unit vectors towards the camera, and across
    low: Floats  # low, high: (2,) m, between which its points lie along these
    high: Floats
    middle: Floats  # (3,) of its points, m
    axes: Floats  # (3, 3) their principal axes, as columns, the flattest first and towards the camera
    least: Floats  # least, most: (3,) m, between which its points lie along these, from their middle
    most: Floats


def compute_alignment_start(seen: Observation, view: View) -> AlignmentStart:
    """Where to begin with a candidate."""
    yaws = seen.upright.yaw + np.array([0.0, np.pi / 6, -np.pi / 6])
    toward = view.camera_position[:2] - np.asarray(seen.upright.center[:2])
    toward = toward / max(float(np.linalg.norm(toward)), 1e-6)
    flat = np.array([toward, (-toward[1], toward[0])], np.float32)
    low, high = np.percentile(seen.points[:, :2] @ flat.T, (3, 97), axis=0)
    middle = seen.points.mean(axis=0)
    _, axes = np.linalg.eigh((seen.points - middle).T @ (seen.points - middle))
    axes = axes * np.where(axes.T @ (view.camera_position - middle) < 0, -1.0, 1.0)
    axes[:, 2] *= np.sign(np.linalg.det(axes))
    least, most = np.percentile((seen.points - middle) @ axes, (2, 98), axis=0)
    top = seen.upright.center[2] + seen.upright.size[2] / 2
    about = _rotvecs_to_matrices(np.column_stack([0 * yaws, 0 * yaws, yaws]))
    return AlignmentStart(about, top, flat, low, high, middle, axes.astype(np.float32), least, most)


def align_asset_to_points(asset: Appearance, start: AlignmentStart, seen: Observation, view: View) -> AlignedPoses:
    """The poses in which the asset fits best."""
    rotations, centers = _propose_start_poses(asset, start, seen)
    begin = _mean_surface_distances(asset, rotations, centers, seen.points[::4])
    best = np.argsort(begin, kind="stable")[:_TRIED]
    rotations, centers = rotations[best], centers[best]
    for _ in range(_ROUNDS):
        rotations, centers = _run_icp_step(asset, rotations, centers, seen.points[::2])
    residual = _mean_surface_distances(asset, rotations, centers, seen.points)
    free_space, height = _measure_floating_and_lowest_z(asset, rotations, centers, view)
    best = np.argsort(residual + 0.7 * free_space, kind="stable")[:KEPT]
    return AlignedPoses(rotations[best], centers[best], residual[best], free_space[best], height[best])


def _propose_start_poses(asset: Appearance, start: AlignmentStart, seen: Observation) -> tuple[Floats, Floats]:
    """Turns (K, 3, 3) and places (K, 3): on each side under the measured top, and along the points' own axes."""
    rotations = (start.yaws[:, None] @ asset.rotations).reshape(-1, 3, 3)
    heights = np.abs(rotations[:, 2]) @ asset.half
    heights = np.maximum(start.top - heights, heights - 0.01)
    reach = np.abs(start.flat @ rotations[:, :2]) @ asset.half  # (K, 2) towards the camera and across
    near = start.high[0] - reach[:, 0]
    low, high = start.low[1], start.high[1]
    flat = [np.broadcast_to(np.array(seen.upright.center[:2]), (len(rotations), 2))]
    # what is hidden may be on either side: in the middle of what is seen, and flush with either end of it
    for side in (np.full(len(rotations), (low + high) / 2), low + reach[:, 1], high - reach[:, 1]):
        flat.append(np.column_stack([near, side]) @ start.flat)
    upright = np.concatenate([np.column_stack([one, heights]) for one in flat])
    # along the points' own axes; the flattest direction is the one that was seen head-on
    local = np.tile((start.least + start.most) / 2, (len(asset.rotations), 1))
    local[:, 0] = start.most[0] - (np.abs(asset.rotations) @ asset.half)[:, 0]
    centers = np.concatenate([upright, local @ start.axes.T + start.middle]).astype(np.float32)
    return np.concatenate([np.tile(rotations, (len(flat), 1, 1)), start.axes @ asset.rotations]), centers


def _find_nearest_surface(
    asset: Appearance, rotations: Floats, centers: Floats, points: Floats
) -> tuple[Floats, Floats, Floats]:
    """For each pose (K) and point (N): its place in the asset's frame, the offset to the surface, the normal there."""
    local = (points - centers[:, None]) @ rotations
    nearest = asset.nearest_point_indices(local)
    return local, asset.points[nearest] - local, asset.normals[nearest]


def _mean_surface_distances(asset: Appearance, rotations: Floats, centers: Floats, points: Floats) -> Floats:
    """(K,) mean distance of points from the surface, m."""
    _, offset, normals = _find_nearest_surface(asset, rotations, centers, points)
    across = np.abs(_dot_product_per_point(offset, normals))
    apart: Floats = np.sqrt(_dot_product_per_point(offset, offset))
    residual = np.minimum(np.where(apart < _NEAR, across, apart), FAR)
    count = max(1, round(_TRIMMED * len(points)))
    return np.partition(residual, count - 1, axis=1)[:, :count].mean(axis=1)


def _run_icp_step(asset: Appearance, rotations: Floats, centers: Floats, points: Floats) -> tuple[Floats, Floats]:
    """One step of point-to-plane alignment for all poses; what is far off has little weight."""
    local, offset, normals = _find_nearest_surface(asset, rotations, centers, points)
    weight = 1 / (1 + _dot_product_per_point(offset, offset)[..., None] * np.float32(1e4))
    jacobian = np.empty((*local.shape[:2], 6), np.float32)
    jacobian[..., :3] = normals
    for axis, (one, two) in enumerate(((1, 2), (2, 0), (0, 1))):
        moment = local[..., one] * normals[..., two] - local[..., two] * normals[..., one]
        jacobian[..., 3 + axis] = moment * (1 / _ARM)
    weighted = (jacobian * (weight / np.float32(len(points)))).transpose(0, 2, 1)
    wanted = _dot_product_per_point(offset, normals)[..., None]
    left: Floats = weighted @ jacobian + _RIDGE
    right: Floats = weighted @ wanted
    step = np.asarray(np.linalg.solve(left, right), np.float32)[:, :, 0]
    # the points move in the asset's frame by the step, so the asset moves by its inverse
    moved = rotations @ _rotvecs_to_matrices(step[:, 3:] / _ARM).transpose(0, 2, 1)
    return moved, centers - (moved @ step[:, :3, None])[:, :, 0]


def _measure_floating_and_lowest_z(
    asset: Appearance, rotations: Floats, centers: Floats, view: View
) -> tuple[Floats, Floats]:
    """(K,) how far the facing surface stands in the air or below the table, and how high its lowest point is, m."""
    back = rotations.transpose(0, 2, 1)
    placed = asset.points[:_PROBES] @ back + centers[:, None]
    facing = (
        _dot_product_per_point(asset.normals[:_PROBES] @ back, placed - view.camera_position.astype(np.float32)) < 0
    )
    rows, columns, depth, inside = view.project_points(placed)
    measured = view.frame.depth[rows, columns] * inside
    known = facing & (measured > 0)
    before = np.minimum(np.maximum(measured - depth - np.float32(AIR), 0), FAR) * known
    below = np.minimum(np.maximum(-placed[:, :, 2] - np.float32(0.003), 0), FAR)
    free_space = before.sum(axis=1) / np.maximum(known.sum(axis=1), 1) + below.mean(axis=1)
    return free_space.astype(np.float32), placed[:, :, 2].min(axis=1)


def _dot_product_per_point(one: Floats, other: Floats) -> Floats:
    """(K, N) products of vectors (K, N, 3)."""
    return np.asarray(np.einsum("kni,kni->kn", one, other))


def _rotvecs_to_matrices(vectors: Floats) -> Floats:
    """(K, 3, 3) the rotations by the vectors' lengths (rad) about them."""
    angle = np.sqrt((vectors * vectors).sum(axis=1)) + np.float32(1e-9)
    x, y, z = (vectors / angle[:, None]).T
    zero = np.zeros_like(x)
    cross = np.stack([zero, -z, y, z, zero, -x, -y, x, zero], axis=1).reshape(-1, 3, 3)
    sine, cosine = np.sin(angle)[:, None, None], np.cos(angle)[:, None, None]
    return (np.eye(3, dtype=np.float32) + sine * cross + (1 - cosine) * cross @ cross).astype(np.float32)
