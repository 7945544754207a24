"""Align assets with a segment's points from many poses at once, by ICP, and measure the fit of each."""

from dataclasses import dataclass

import numpy as np

from grs_agents.perception.matching.asset_appearance import Appearance, Floats
from grs_agents.perception.matching.segment_features import SegmentFeatures
from grs_agents.perception.types import RGBDFrame, TableFrame

FAR = np.float32(0.02)  # larger distances (m) count as this
AIR = 0.008  # tolerance of the free-space test, m
KEPT = 4  # number of poses that are compared in colour
_ROUNDS = 4  # ICP steps
_TRIED = 10  # number of start poses that are aligned
_PROBES = 250  # number of surface points of the free-space test
_NEAR = np.float32(0.008)  # nearer points (m) are measured across the surface
_TRIMMED = 0.92  # share of the points in the trimmed mean
_FREE_SPACE_WEIGHT = 0.7
_SLACK_BELOW = np.float32(0.003)  # a surface may be this far below the table, m
_RIDGE = np.diag([2e-3, 2e-3, 2e-3, 0.05, 0.05, 0.05]).astype(np.float32)
_ARM = np.float32(0.05)  # a rotation by 1 rad counts as a shift by this, m


@dataclass(frozen=True)
class AlignedPoses:
    """Poses of an asset, the best first."""

    rotations: Floats  # (K, 3, 3) from the asset's frame (centre of its bounding box) to the robot frame
    centers: Floats  # (K, 3) positions of that centre, m, robot frame
    residual: Floats  # (K,) trimmed mean distance of the segment's points from the surface, m
    free_space: Floats  # (K,) mean depth of the visible surface in measured free space or below the table, m
    height: Floats  # (K,) height of the lowest point above the table, m

    @property
    def pose_costs(self) -> Floats:
        """Costs (K,), m."""
        return self.residual + np.float32(_FREE_SPACE_WEIGHT) * self.free_space


@dataclass(frozen=True)
class AlignmentStart:
    """Frames of a segment's points from which all assets start."""

    yaws: Floats  # (Y, 3, 3) rotations about the vertical
    top: float  # height of the box's top, m
    flat: Floats  # (2, 2) horizontal unit vectors towards the camera, and across
    low: Floats  # low, high: (2,) m, range of the points along ``flat``
    high: Floats
    middle: Floats  # (3,) mean of the points, m
    axes: Floats  # (3, 3) their principal axes, as columns, the shortest first and towards the camera
    least: Floats  # least, most: (3,) m, range of the points along ``axes``, from their mean
    most: Floats


def compute_alignment_start(seen: SegmentFeatures, table: TableFrame) -> AlignmentStart:
    """Compute the frames in which assets start for a segment."""
    yaws = seen.upright.yaw + np.array([0.0, np.pi / 6, -np.pi / 6])
    toward = table.camera_position[:2] - np.asarray(seen.upright.center[:2])
    toward = toward / max(float(np.linalg.norm(toward)), 1e-6)
    flat = np.array([toward, (-toward[1], toward[0])], np.float32)
    low, high = np.percentile(seen.points[:, :2] @ flat.T, (3, 97), axis=0)
    middle = seen.points.mean(axis=0)
    _, axes = np.linalg.eigh((seen.points - middle).T @ (seen.points - middle))
    axes = axes * np.where(axes.T @ (table.camera_position - middle) < 0, -1.0, 1.0)
    axes[:, 2] *= np.sign(np.linalg.det(axes))
    least, most = np.percentile((seen.points - middle) @ axes, (2, 98), axis=0)
    top = seen.upright.center[2] + seen.upright.size[2] / 2
    about = _rotvecs_to_matrices(np.column_stack([0 * yaws, 0 * yaws, yaws]))
    return AlignmentStart(about, top, flat, low, high, middle, axes.astype(np.float32), least, most)


def align_asset_to_points(
    asset: Appearance, start: AlignmentStart, seen: SegmentFeatures, frame: RGBDFrame, table: TableFrame
) -> AlignedPoses:
    """Align an asset from all start poses; returns the best `KEPT` poses."""
    rotations, centers = _propose_start_poses(asset, start, seen)
    begin = _mean_surface_distances(asset, rotations, centers, seen.points[::4])
    best = np.argsort(begin, kind="stable")[:_TRIED]
    rotations, centers = rotations[best], centers[best]
    for _ in range(_ROUNDS):
        rotations, centers = _run_icp_step(asset, rotations, centers, seen.points[::2])
    residual = _mean_surface_distances(asset, rotations, centers, seen.points)
    free_space, height = _measure_free_space_and_height(asset, rotations, centers, frame, table)
    best = np.argsort(residual + _FREE_SPACE_WEIGHT * free_space, kind="stable")[:KEPT]
    return AlignedPoses(rotations[best], centers[best], residual[best], free_space[best], height[best])


def _propose_start_poses(asset: Appearance, start: AlignmentStart, seen: SegmentFeatures) -> tuple[Floats, Floats]:
    """Start rotations (K, 3, 3) and centres (K, 3): on each side below the box's top, and along the principal axes."""
    rotations = (start.yaws[:, None] @ asset.rotations).reshape(-1, 3, 3)
    heights = np.abs(rotations[:, 2]) @ asset.half
    heights = np.maximum(start.top - heights, heights - 0.01)
    reach = np.abs(start.flat @ rotations[:, :2]) @ asset.half  # (K, 2) towards the camera and across
    near = start.high[0] - reach[:, 0]
    low, high = start.low[1], start.high[1]
    flat = [np.broadcast_to(np.array(seen.upright.center[:2]), (len(rotations), 2))]
    # the hidden part may be on either side: centred on the points, and flush with either end of them
    for side in (np.full(len(rotations), (low + high) / 2), low + reach[:, 1], high - reach[:, 1]):
        flat.append(np.column_stack([near, side]) @ start.flat)
    upright = np.concatenate([np.column_stack([position, heights]) for position in flat])
    # along the principal axes; the shortest is the viewing direction of a face seen head-on
    local = np.tile((start.least + start.most) / 2, (len(asset.rotations), 1))
    local[:, 0] = start.most[0] - (np.abs(asset.rotations) @ asset.half)[:, 0]
    centers = np.concatenate([upright, local @ start.axes.T + start.middle]).astype(np.float32)
    return np.concatenate([np.tile(rotations, (len(flat), 1, 1)), start.axes @ asset.rotations]), centers


def _find_nearest_surface(
    asset: Appearance, rotations: Floats, centers: Floats, points: Floats
) -> tuple[Floats, Floats, Floats]:
    """For poses (K) and points (N), each (K, N, 3): point in the asset's frame, offset to the surface, normal there."""
    local = (points - centers[:, None]) @ rotations
    nearest = asset.nearest_point_indices(local)
    return local, asset.points[nearest] - local, asset.normals[nearest]


def _mean_surface_distances(asset: Appearance, rotations: Floats, centers: Floats, points: Floats) -> Floats:
    """Trimmed mean distance (K,) of points from the surface, m."""
    _, offset, normals = _find_nearest_surface(asset, rotations, centers, points)
    across = np.abs(_dot_product_per_point(offset, normals))
    apart: Floats = np.sqrt(_dot_product_per_point(offset, offset))
    residual = np.minimum(np.where(apart < _NEAR, across, apart), FAR)
    count = max(1, round(_TRIMMED * len(points)))
    return np.partition(residual, count - 1, axis=1)[:, :count].mean(axis=1)


def _run_icp_step(asset: Appearance, rotations: Floats, centers: Floats, points: Floats) -> tuple[Floats, Floats]:
    """A step of point-to-plane ICP for all poses at once; distant points have little weight."""
    local, offset, normals = _find_nearest_surface(asset, rotations, centers, points)
    weight = 1 / (1 + _dot_product_per_point(offset, offset)[..., None] * np.float32(1e4))
    jacobian = np.empty((*local.shape[:2], 6), np.float32)
    jacobian[..., :3] = normals
    for axis, (first, second) in enumerate(((1, 2), (2, 0), (0, 1))):
        moment = local[..., first] * normals[..., second] - local[..., second] * normals[..., first]
        jacobian[..., 3 + axis] = moment * (1 / _ARM)
    weighted = (jacobian * (weight / np.float32(len(points)))).transpose(0, 2, 1)
    target = _dot_product_per_point(offset, normals)[..., None]
    left: Floats = weighted @ jacobian + _RIDGE
    right: Floats = weighted @ target
    step = np.asarray(np.linalg.solve(left, right), np.float32)[:, :, 0]
    # the points move in the asset's frame by the step, so the asset moves by its inverse
    moved = rotations @ _rotvecs_to_matrices(step[:, 3:] / _ARM).transpose(0, 2, 1)
    return moved, centers - (moved @ step[:, :3, None])[:, :, 0]


def _measure_free_space_and_height(
    asset: Appearance, rotations: Floats, centers: Floats, frame: RGBDFrame, table: TableFrame
) -> tuple[Floats, Floats]:
    """Free-space violation of the visible surface (K,), m, and the height of the lowest point (K,), m."""
    camera, pose = frame.camera, np.asarray(table.T_robot_cam, np.float32)
    back = rotations.transpose(0, 2, 1)
    placed = asset.points[:_PROBES] @ back + centers[:, None]
    gaze = placed - table.camera_position.astype(np.float32)
    facing = _dot_product_per_point(asset.normals[:_PROBES] @ back, gaze) < 0
    local = (placed - pose[:3, 3]) @ pose[:3, :3]
    depth = np.maximum(local[..., 2], np.float32(1e-3))
    columns = np.rint(local[..., 0] / depth * np.float32(camera.fx) + np.float32(camera.cx)).astype(np.int64)
    rows = np.rint(local[..., 1] / depth * np.float32(camera.fy) + np.float32(camera.cy)).astype(np.int64)
    height, width = frame.depth.shape
    inside = (columns >= 0) & (columns < width) & (rows >= 0) & (rows < height)
    measured = frame.depth[np.clip(rows, 0, height - 1), np.clip(columns, 0, width - 1)] * inside
    known = facing & (measured > 0)
    before = np.minimum(np.maximum(measured - depth - np.float32(AIR), 0), FAR) * known
    below = np.minimum(np.maximum(-placed[:, :, 2] - _SLACK_BELOW, 0), FAR)
    free_space = before.sum(axis=1) / np.maximum(known.sum(axis=1), 1) + below.mean(axis=1)
    return free_space.astype(np.float32), placed[:, :, 2].min(axis=1)


def _dot_product_per_point(first: Floats, second: Floats) -> Floats:
    """Products (K, N) of vectors (K, N, 3)."""
    return np.asarray(np.einsum("kni,kni->kn", first, second))


def _rotvecs_to_matrices(vectors: Floats) -> Floats:
    """Rotation matrices (K, 3, 3) of rotation vectors (K, 3), rad."""
    angle = np.sqrt((vectors * vectors).sum(axis=1)) + np.float32(1e-9)
    x, y, z = (vectors / angle[:, None]).T
    zero = np.zeros_like(x)
    cross = np.stack([zero, -z, y, z, zero, -x, -y, x, zero], axis=1).reshape(-1, 3, 3)
    sine, cosine = np.sin(angle)[:, None, None], np.cos(angle)[:, None, None]
    return (np.eye(3, dtype=np.float32) + sine * cross + (1 - cosine) * cross @ cross).astype(np.float32)
