"""Register a matched asset to an object's points: pose hypotheses, ICP, and refinement of the cheapest pose."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from grs_agents.base import Pose, Quat, Vec3
from grs_agents.base.geometry.transforms import (
    matrix_to_quaternion,
    pose_matrix,
    rotation_about_axis,
    rotation_about_z,
    to_vec3,
)
from grs_agents.library.library import Library
from grs_agents.library.shapes import matrix_from_quaternion
from grs_agents.perception.asset_surfaces import (
    RegistrationCloud,
    SurfaceSamples,
    Symmetry,
    Tree,
    align_point_clouds,
    asset_triangle_corners,
    cube_rotation_matrices,
    find_asset_symmetry,
    sample_asset_surface,
)
from grs_agents.perception.configuration import DEFAULT
from grs_agents.perception.registration.pose_cost import (
    ObservedPoints,
    SilhouetteWindow,
    residual_per_pose,
    sample_observed_points,
    total_cost_per_pose,
)
from grs_agents.perception.segmentation.candidates import fit_asset_to_box
from grs_agents.perception.types import Array, Mask, PoseMethod, RGBDFrame, TableFrame, UprightBox

CONFIG = DEFAULT.registration
HYPOTHESES = CONFIG.hypotheses

OverlapPerPose = Callable[[Array], Array]
"""Overlap (K,), m, of an asset with other objects at poses (K, 4, 4) of the centre of its bounding box."""


@dataclass(frozen=True)
class Registered:
    """The registered pose of an asset."""

    position: Vec3  # centre of its bounding box, m, robot frame
    orientation: Quat  # xyzw
    size: Vec3  # extents along the world's axes before the yaw, m
    residual: float  # distance of the object's points from its surface: mean of the nearest 90 %, m
    method: PoseMethod  # ``registered``, or ``box`` where the measured box fits no worse
    round: bool  # rotationally symmetric about the vertical: the yaw is arbitrary
    cost: float = 0.0  # the residual, and the penalties of the pose, m


@dataclass(frozen=True)
class _Search:
    """The search for the pose of an asset among the points of an object."""

    surface: SurfaceSamples
    tree: Tree
    seen: ObservedPoints
    upright: UprightBox
    symmetry: Symmetry
    overlap: OverlapPerPose | None = None

    @classmethod
    def from_asset(
        cls, asset: str, library: Library, upright: UprightBox, seen: ObservedPoints, overlap: OverlapPerPose | None
    ) -> "_Search":
        surface = sample_asset_surface(asset, library)
        return cls(surface, Tree(surface.points), seen, upright, find_asset_symmetry(asset, library), overlap)

    def cost_per_pose(self, poses: Array, factor: int = 1) -> Array:
        """Cost (K,), m, of poses (K, 4, 4), with the penalty for overlap with other objects."""
        cost = self.cost_without_neighbors(poses, factor)
        if self.overlap is None:
            return cost
        return cost + CONFIG.entered_weight * np.maximum(self.overlap(poses) - CONFIG.entered, 0)

    def cost_without_neighbors(self, poses: Array, factor: int = 1) -> Array:
        """Cost (K,), m, of poses (K, 4, 4): fit to the photo, and penalties for lying, tilted and sunk assets."""
        lying = CONFIG.lying * (poses[:, 2, 2] < 0.9)
        tilted = CONFIG.tilted * (np.abs(poses[:, 2, :3]).max(axis=1) < math.cos(math.radians(0.1)))
        seen = self.seen.subsample_points(factor)
        lowest = (self.surface.points[: seen.samples] @ poses[:, 2, :3].T).min(axis=0) + poses[:, 2, 3]
        sunk = np.maximum(-lowest - CONFIG.sunk, 0)
        return total_cost_per_pose(self.surface, self.tree, poses, seen) + lying + tilted + sunk

    def registered(self, pose: Array, size: Vec3, method: PoseMethod) -> Registered:
        """The outcome at a pose (4, 4)."""
        residual = float(residual_per_pose(self.surface, self.tree, pose[None], self.seen)[0])
        return Registered(
            position=to_vec3(pose[:3, 3]),
            orientation=matrix_to_quaternion(pose[:3, :3]),
            size=size,
            residual=residual,
            method=method,
            round=self.is_yaw_symmetric(pose),
            cost=float(self.cost_without_neighbors(pose[None])[0]),
        )

    def is_yaw_symmetric(self, pose: Array) -> bool:
        """Whether an axis of rotational symmetry is vertical at a pose (4, 4)."""
        return any(abs(float(pose[2, :3] @ axis)) > math.cos(math.radians(5)) for axis in self.symmetry.axes)


def register_asset(
    asset: str,
    library: Library,
    upright: UprightBox,
    frame: RGBDFrame,
    table: TableFrame,
    mask: Mask,
    overlap: OverlapPerPose | None = None,
) -> Registered:
    """Register an asset to the points of a mask (H, W).

    Args:
        asset: its library name.
        library: the library that holds it.
        upright: the box measured of the object; hypotheses start there.
        frame: the photo.
        table: the table in it.
        mask: the object's pixels.
        overlap: overlap with known objects around, which is penalised.

    Raises:
        UnknownNameError: the library has no such asset.
    """
    position, orientation, size = fit_asset_to_box(upright, library.asset(asset).size)
    begin = pose_matrix(matrix_from_quaternion(orientation), np.array(position))
    seen = sample_observed_points(frame, table, mask)
    search = _Search.from_asset(asset, library, upright, seen, overlap)
    if len(seen.points) < CONFIG.fewest:
        return Registered(position, orientation, size, 0.0, "box", search.is_yaw_symmetric(begin))
    corners = asset_triangle_corners(asset, library)
    corners = corners - (corners.min(axis=(0, 1)) + corners.max(axis=(0, 1))) / 2
    best = _find_cheapest_pose(search, corners, SilhouetteWindow.from_mask(frame, table, mask))
    registered_cost, box_cost = search.cost_per_pose(np.stack([best, begin]))
    registered = search.registered(best, _extents_without_yaw(best[:3, :3], search.surface), "registered")
    if registered_cost > box_cost - CONFIG.better or registered.residual > CONFIG.worst:
        boxed = search.registered(begin, size, "box")
        return replace(boxed, position=position, orientation=orientation)
    return registered


def registration_cost(
    asset: str, pose: Pose, library: Library, upright: UprightBox, frame: RGBDFrame, table: TableFrame, mask: Mask
) -> float:
    """The cost of `Registered`, m, of an asset whose bounding box has its centre and rotation at ``pose``."""
    search = _Search.from_asset(asset, library, upright, sample_observed_points(frame, table, mask), None)
    matrix = pose_matrix(matrix_from_quaternion(pose[1]), np.array(pose[0]))
    return float(search.cost_without_neighbors(matrix[None])[0])


def _extents_without_yaw(turn: Array, surface: SurfaceSamples) -> Vec3:
    """Extents (m) along the world's axes once the yaw of a rotation (3, 3), which may lean, is removed."""
    up = int(np.argmax(np.abs(turn[2])))
    side = turn[:, (up + 1) % 3]
    yaw = math.atan2(side[1], side[0])
    yaw -= round(yaw / (math.pi / 2)) * math.pi / 2
    return to_vec3(2 * np.abs(rotation_about_z(-yaw) @ turn) @ surface.half)


def _find_cheapest_pose(search: _Search, corners: Array, silhouette: SilhouetteWindow) -> Array:
    """The pose (4, 4) of least cost; the silhouette decides among poses that agree with the points.

    ``corners`` (T, 3, 3) are the asset's triangles about the centre of its bounding box.
    """

    def cost_with_silhouette(poses: Array, factor: int) -> Array:
        differences = silhouette.difference_per_pose(corners, poses)
        return search.cost_per_pose(poses, factor) + CONFIG.silhouette.weight * differences

    half = search.surface.half
    seen = search.seen.subsample_points(CONFIG.medium)
    source = RegistrationCloud(seen.points)
    every = propose_initial_poses(half, search.symmetry, search.upright, seen, source.normals)
    good = every[np.argsort(search.cost_per_pose(every, CONFIG.coarse), kind="stable")[: CONFIG.slid]]
    more = np.concatenate([good, propose_shifted_poses(good, half, search.seen)])
    ranked = more[np.argsort(search.cost_per_pose(more, CONFIG.coarse), kind="stable")]
    starts: list[Array] = []  # the first few that neither are near each other nor look alike
    for pose in ranked:
        if all(
            np.linalg.norm(pose[:3, 3] - start[:3, 3]) > CONFIG.apart
            or search.symmetry.rotation_error_degrees(pose[:3, :3], start[:3, :3]) > CONFIG.look_angle
            for start in starts
        ):
            starts.append(pose)
        if len(starts) == CONFIG.aligned:
            break
    poses = [starts[0]]
    for start in starts:
        aligned = _align_to_visible_surface(search, start, source)
        resting = _snap_pose_to_resting_side(aligned, search)
        poses += [aligned] if resting is None else [aligned, resting]
    stack = np.stack(poses)
    best = stack[np.argsort(cost_with_silhouette(stack, CONFIG.medium), kind="stable")[: CONFIG.refined]]
    refined = np.stack([_refine_pose(pose, search.cost_per_pose, CONFIG.steps, CONFIG.medium) for pose in best])
    cheapest = refined[int(cost_with_silhouette(refined, 1).argmin())]
    return _refine_pose(cheapest, cost_with_silhouette, CONFIG.steps[-CONFIG.last :], 1)


def _align_to_visible_surface(search: _Search, start: Array, source: RegistrationCloud) -> Array:
    """Align the points with the part of the surface that is visible at the present pose, twice (ICP)."""
    pose = start
    for reach in (CONFIG.partner_distance, CONFIG.partner_distance / 2):
        turn = pose[:3, :3]
        count = len(search.surface.points) // CONFIG.medium
        points, normals = search.surface.points[:count], search.surface.normals[:count]
        gaze = points @ turn.T + pose[:3, 3] - search.seen.camera_position
        facing = np.einsum("ni,ni->n", normals @ turn.T, gaze) < 0
        if facing.sum() < CONFIG.fewest:
            return pose
        pose = _invert_pose(align_point_clouds(RegistrationCloud(points[facing]), source, _invert_pose(pose), reach))
    return pose


def _invert_pose(pose: Array) -> Array:
    return np.asarray(np.linalg.inv(pose), np.float64)


def _snap_pose_to_resting_side(pose: Array, search: _Search) -> Array | None:
    """The pose turned onto the side it nearly rests on, at the height of its support; ``None`` where it leans."""
    turn = pose[:3, :3]
    up = int(np.argmax(np.abs(turn[2])))
    axis = turn[:, up] * np.sign(turn[2, up])
    angle = math.acos(min(1.0, float(axis[2])))
    if angle > CONFIG.leaning:
        return None
    whole = rotation_about_axis(np.cross(axis, (0.0, 0.0, 1.0)), angle) @ turn
    height = float(np.abs(whole[2]) @ search.surface.half)
    bottom = float(pose[2, 3]) - height
    box_bottom = search.upright.center[2] - search.upright.size[2] / 2
    rests = abs(bottom - box_bottom) < CONFIG.rests
    return pose_matrix(whole, np.array([pose[0, 3], pose[1, 3], (box_bottom if rests else bottom) + height]))


def _refine_pose(
    pose: Array, cost_per_pose: Callable[[Array, int], Array], steps: Sequence[tuple[float, float]], factor: int
) -> Array:
    """Pattern search: shift along the axes and turn about z by ever smaller steps while the cost falls."""
    best, least = pose, float(cost_per_pose(pose[None], factor)[0])
    for shift, angle in steps:
        for _ in range(3):
            tried = np.stack([best] * 8)
            for axis in range(3):
                tried[2 * axis, axis, 3] += shift
                tried[2 * axis + 1, axis, 3] -= shift
            tried[6, :3, :3] = rotation_about_z(angle) @ best[:3, :3]
            tried[7, :3, :3] = rotation_about_z(-angle) @ best[:3, :3]
            values = cost_per_pose(tried, factor)
            first = int(values.argmin())
            if values[first] >= least:
                break
            best, least = tried[first], float(values[first])
    return best


def propose_initial_poses(
    half: Array, symmetry: Symmetry, upright: UprightBox, seen: ObservedPoints, normals: Array
) -> Array:
    """Pose hypotheses (K, 4, 4): each distinct side of the asset up in the measured box, and on the visible planes.

    Args:
        half: half the asset's extents (3,), m.
        symmetry: the asset's symmetry; of poses that look alike the first is proposed.
        upright: the measured box.
        seen: the object's points.
        normals: unit normals (N, 3) at the points.
    """
    turns = _distinct_quarter_turns(symmetry.turns.tobytes(), symmetry.axes.tobytes())
    bottom, top = (upright.center[2] + side * upright.size[2] / 2 for side in (-1, 1))
    poses: list[Array] = []
    for between in (0.0, math.pi / 4):
        for turn in turns:
            whole = rotation_about_z(upright.yaw + between) @ turn
            height = float(np.abs(turn[2]) @ half)
            poses.append(pose_matrix(whole, np.array([*upright.center[:2], bottom + height])))
            if top - height > bottom + height / 5:  # its bottom may be hidden: align the tops
                poses.append(pose_matrix(whole, np.array([*upright.center[:2], top - height])))
    axes = estimate_leaning_axes(seen, normals)
    if axes is not None:
        # The visible sides are the outermost points: along each axis the centre lies half an extent behind them.
        low, high = np.percentile(seen.points @ axes, (2, 98), axis=0)
        to_eye = (seen.camera_position - seen.points.mean(axis=0)) @ axes
        distance = float(np.linalg.norm(to_eye))
        near, away = to_eye > HYPOTHESES.oblique * distance, to_eye < -HYPOTHESES.oblique * distance
        for turn in turns:
            extents, middle = np.abs(turn) @ half, (low + high) / 2
            middle[near], middle[away] = (high - extents)[near], (low + extents)[away]
            poses.append(pose_matrix(axes @ turn, np.asarray(axes @ middle, np.float64)))
    return np.stack(poses)


def propose_shifted_poses(poses: Array, half: Array, seen: ObservedPoints) -> Array:
    """Shifted poses (K, 4, 4): the visible part of a partly hidden object may be either end of the asset."""
    shifted: list[Array] = []
    for pose in poses:
        low, high = np.percentile((seen.points - pose[:3, 3]) @ pose[:3, :3], (2, 98), axis=0)
        for axis in range(3):
            if abs(2 * half[axis] - (high - low)[axis]) < HYPOTHESES.hidden or abs(pose[2, axis]) > 0.7:
                continue
            for shift in (low[axis] + half[axis], high[axis] - half[axis]):
                shifted.append(pose_matrix(pose[:3, :3], pose[:3, 3] + shift * pose[:3, axis]))
    return np.stack(shifted) if shifted else poses[:0]


@lru_cache(maxsize=128)
def _distinct_quarter_turns(turns: bytes, axes: bytes) -> tuple[Array, ...]:
    """The quarter turns of which no two look alike, for the arrays of a `Symmetry` as bytes."""
    symmetry = Symmetry(np.frombuffer(turns).reshape(-1, 3, 3), np.frombuffer(axes).reshape(-1, 3))
    distinct: list[Array] = []
    for turn in cube_rotation_matrices():
        if all(symmetry.rotation_error_degrees(turn, earlier) >= 1.0 for earlier in distinct):
            distinct.append(turn)
    return tuple(distinct)


def estimate_leaning_axes(seen: ObservedPoints, normals: Array) -> Array | None:
    """Axes (3, 3) of a leaning object: the normal of its largest plane, of a plane across it, and the third.

    ``None`` where an axis is vertical, as it is for upright objects.
    """
    outwards = normals * -np.sign(np.einsum("ni,ni->n", normals, seen.points - seen.camera_position))[:, None]
    alike = outwards @ outwards.T > math.cos(HYPOTHESES.same_plane)
    first = _mean_normal(outwards, alike[int(alike.sum(axis=1).argmax())])
    across = np.abs(outwards @ first) < math.sin(HYPOTHESES.same_plane)
    counts = (alike & across[:, None] & across).sum(axis=1)
    most = int(counts.argmax())
    if counts[most] > HYPOTHESES.second_plane * len(outwards):
        second = _mean_normal(outwards, alike[most] & across)
        second -= (second @ first) * first
    else:  # the longer side within the plane
        flat = seen.points - seen.points.mean(axis=0)
        flat -= np.outer(flat @ first, first)
        second = np.linalg.svd(flat, full_matrices=False)[2][0]
    second /= np.linalg.norm(second)
    axes = np.stack([second, np.cross(first, second), first], axis=1)
    return None if np.abs(axes[2]).max() > math.cos(HYPOTHESES.level) else axes


def _mean_normal(normals: Array, chosen: Array) -> Array:
    total = normals[np.asarray(chosen, np.bool_)].sum(axis=0)
    return total / max(float(np.linalg.norm(total)), 1e-9)
