"""Register a matched asset to an object's points: from several turns, by what the camera saw and could see through."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

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
    Cloud,
    Surface,
    Symmetry,
    Tree,
    align_point_clouds,
    asset_triangle_corners,
    find_asset_symmetry,
    sample_asset_surface,
)
from grs_agents.perception.configuration import DEFAULT
from grs_agents.perception.registration.pose_cost import (
    ObservedPoints,
    residual_per_pose,
    sample_observed_points,
    total_cost_per_pose,
)
from grs_agents.perception.registration.pose_hypotheses import propose_initial_poses, propose_shifted_poses
from grs_agents.perception.registration.silhouette import SeenSilhouette
from grs_agents.perception.segmentation.candidates import fit_asset_to_box
from grs_agents.perception.types import Array, Mask, PoseMethod, RGBDFrame, TableFrame, UprightBox

CONFIG = DEFAULT.registration

Entered = Callable[[Array], Array]
"""How deep an asset is in other objects at each of (K, 4, 4) poses of the centre of its bounding box, (K,) m."""


@dataclass(frozen=True)
class Registered:
    """Where an asset stands."""

    position: Vec3  # centre of its bounding box, m, robot frame
    orientation: Quat  # xyzw
    size: Vec3  # extents along the axes after the turn, before the yaw, m
    residual: float  # how far the object's points are off its surface: mean of the nearest 90 %, m
    method: PoseMethod  # ``registered``, or ``box`` where that fits no worse
    round: bool  # it looks the same at any yaw
    cost: float = 0.0  # the residual, and what is unlikely about the pose, m


@dataclass(frozen=True)
class _Search:
    """An asset's surface, what was seen of the object, and the known objects around it."""

    surface: Surface
    tree: Tree
    seen: ObservedPoints
    upright: UprightBox
    symmetry: Symmetry
    entered: Entered | None = None

    @classmethod
    def from_asset(
        cls, asset: str, library: Library, upright: UprightBox, seen: ObservedPoints, entered: Entered | None = None
    ) -> "_Search":
        """The search for an asset of the library."""
        surface = sample_asset_surface(asset, library)
        tree, symmetry = Tree(surface.points), find_asset_symmetry(asset, library)
        return cls(surface, tree, seen, upright, symmetry, entered)

    @property
    def measured_box_bottom(self) -> float:
        """Where the measured box begins, m."""
        return self.upright.center[2] - self.upright.size[2] / 2

    def cost_per_pose(self, poses: Array, factor: int = 1) -> Array:
        """What `pose_cost.costs` says, and what is unlikely about each of (K, 4, 4) poses: (K,) m."""
        if self.entered is None:
            return self.cost_without_neighbors(poses, factor)
        beyond = np.maximum(self.entered(poses) - CONFIG.entered, 0)
        return self.cost_without_neighbors(poses, factor) + CONFIG.entered_weight * beyond

    def cost_without_neighbors(self, poses: Array, factor: int = 1) -> Array:
        """The same, whatever stands around."""
        lying = CONFIG.lying * (poses[:, 2, 2] < 0.9)
        tilted = CONFIG.tilted * (np.abs(poses[:, 2, :3]).max(axis=1) < math.cos(math.radians(0.1)))
        seen = self.seen.subsample_points(factor)
        lowest = (self.surface.points[: seen.samples] @ poses[:, 2, :3].T).min(axis=0) + poses[:, 2, 3]
        sunk = np.maximum(-lowest - CONFIG.sunk, 0)
        return total_cost_per_pose(self.surface, self.tree, poses, seen) + lying + tilted + sunk

    def residual_at_pose(self, pose: Array) -> float:
        """How far the object's points are off the surface at a pose (4, 4), m."""
        return float(residual_per_pose(self.surface, self.tree, pose[None], self.seen)[0])


def register_asset(
    asset: str,
    library: Library,
    upright: UprightBox,
    frame: RGBDFrame,
    table: TableFrame,
    mask: Mask,
    entered: Entered | None = None,
) -> Registered:
    """Lay an asset into the points of a mask (H, W).

    Args:
        upright: the box measured of the object, where the search begins.
        entered: how deep the asset is in what is known to stand around, which it is not to be.

    Raises:
        UnknownNameError: the library has no such asset.
    """
    position, orientation, size = fit_asset_to_box(upright, library.asset(asset).size)
    begin = pose_matrix(matrix_from_quaternion(orientation), np.array(position))
    seen = sample_observed_points(frame, table, mask)
    search = _Search.from_asset(asset, library, upright, seen, entered)
    if len(seen.points) < CONFIG.fewest:
        return Registered(position, orientation, size, 0.0, "box", _is_yaw_symmetric(begin, search.symmetry))
    corners = asset_triangle_corners(asset, library)
    corners = corners - (corners.min(axis=(0, 1)) + corners.max(axis=(0, 1))) / 2
    best = _find_cheapest_pose(search, corners, SeenSilhouette.from_mask(frame, table, mask))
    off, (registered, boxed) = search.residual_at_pose(best), search.cost_per_pose(np.stack([best, begin]))
    if registered > boxed - CONFIG.better or off > CONFIG.worst:
        off, cost = search.residual_at_pose(begin), float(search.cost_without_neighbors(begin[None])[0])
        return Registered(position, orientation, size, off, "box", _is_yaw_symmetric(begin, search.symmetry), cost)
    position, rotation = to_vec3(best[:3, 3]), matrix_to_quaternion(best[:3, :3])
    extents, free = _extents_without_yaw(best[:3, :3], search.surface), _is_yaw_symmetric(best, search.symmetry)
    cost = float(search.cost_without_neighbors(best[None])[0])
    return Registered(position, rotation, extents, off, "registered", free, cost)


def registration_cost(
    asset: str, pose: Pose, library: Library, upright: UprightBox, frame: RGBDFrame, table: TableFrame, mask: Mask
) -> float:
    """What `Registered` calls its cost, m, of an asset whose bounding box has its centre and rotation at ``pose``."""
    search = _Search.from_asset(asset, library, upright, sample_observed_points(frame, table, mask))
    return float(
        search.cost_without_neighbors(pose_matrix(matrix_from_quaternion(pose[1]), np.array(pose[0]))[None])[0]
    )


def _is_yaw_symmetric(pose: Array, symmetry: Symmetry) -> bool:
    return any(abs(float(pose[2, :3] @ axis)) > math.cos(math.radians(5)) for axis in symmetry.axes)


def _extents_without_yaw(turn: Array, surface: Surface) -> Vec3:
    """Extents along the world's axes once the yaw is taken back, for a turn that may lean."""
    up = int(np.argmax(np.abs(turn[2])))
    side = turn[:, (up + 1) % 3]
    yaw = math.atan2(side[1], side[0])
    yaw -= round(yaw / (math.pi / 2)) * math.pi / 2
    x, y, z = (float(value) for value in 2 * np.abs(rotation_about_z(-yaw) @ turn) @ surface.half)
    return (x, y, z)


def _find_cheapest_pose(search: _Search, corners: Array, silhouette: SeenSilhouette) -> Array:
    """The pose (4, 4) that costs least; of poses that agree with the points, the ``silhouette`` tells.
    ``corners`` (T, 3, 3) are the asset's triangles around the centre of its bounding box."""

    def cost_with_silhouette(poses: Array, factor: int) -> Array:
        differs = silhouette.difference_per_pose(corners, poses)
        return search.cost_per_pose(poses, factor) + CONFIG.silhouette.weight * differs

    half = search.surface.half
    seen = search.seen.subsample_points(CONFIG.medium)
    source = Cloud(seen.points)
    every = propose_initial_poses(half, search.symmetry, search.upright, seen, source.normals)
    good = every[np.argsort(search.cost_per_pose(every, CONFIG.coarse), kind="stable")[: CONFIG.slid]]
    more = np.concatenate([good, propose_shifted_poses(good, half, search.seen)])
    chosen = _select_distinct_poses(more[np.argsort(search.cost_per_pose(more, CONFIG.coarse), kind="stable")], search)
    poses = [chosen[0]]
    for start in chosen:
        aligned = _align_to_visible_surface(search, start, source)
        straight = _snap_pose_to_resting_side(aligned, search)
        poses += [aligned] if straight is None else [aligned, straight]
    stack = np.stack(poses)
    best = stack[np.argsort(cost_with_silhouette(stack, CONFIG.medium), kind="stable")[: CONFIG.refined]]
    refined = np.stack([_refine_pose(pose, search.cost_per_pose, CONFIG.steps, CONFIG.medium) for pose in best])
    cheapest = refined[int(cost_with_silhouette(refined, 1).argmin())]
    return _refine_pose(cheapest, cost_with_silhouette, CONFIG.steps[-CONFIG.last :], 1)


def _select_distinct_poses(poses: Array, search: _Search) -> list[Array]:
    """The first few of (K, 4, 4) poses that are neither near each other nor look alike."""
    chosen: list[Array] = []
    for pose in poses:
        if all(
            np.linalg.norm(pose[:3, 3] - other[:3, 3]) > CONFIG.apart
            or search.symmetry.rotation_error_degrees(pose[:3, :3], other[:3, :3]) > CONFIG.look_angle
            for other in chosen
        ):
            chosen.append(pose)
        if len(chosen) == CONFIG.aligned:
            break
    return chosen


def _align_to_visible_surface(search: _Search, start: Array, source: Cloud) -> Array:
    """Align the points with the part of the surface that the camera sees at the pose before, twice."""
    pose = start
    for reach in (CONFIG.partner_distance, CONFIG.partner_distance / 2):
        turn = pose[:3, :3]
        points, normals = (one[: len(one) // CONFIG.medium] for one in (search.surface.points, search.surface.normals))
        gaze = points @ turn.T + pose[:3, 3] - search.seen.camera_position
        facing = np.einsum("ni,ni->n", normals @ turn.T, gaze) < 0
        if facing.sum() < CONFIG.fewest:
            return pose
        pose = _invert_pose(align_point_clouds(Cloud(points[facing]), source, _invert_pose(pose), reach))
    return pose


def _invert_pose(pose: Array) -> Array:
    return np.asarray(np.linalg.inv(pose), np.float64)


def _snap_pose_to_resting_side(pose: Array, search: _Search) -> Array | None:
    """The pose on the side it nearly rests on, at the height of what it rests on; ``None`` where it leans."""
    turn = pose[:3, :3]
    up = int(np.argmax(np.abs(turn[2])))
    axis = turn[:, up] * np.sign(turn[2, up])
    angle = math.acos(min(1.0, float(axis[2])))
    if angle > CONFIG.leaning:
        return None
    whole = rotation_about_axis(np.cross(axis, (0.0, 0.0, 1.0)), angle) @ turn
    height = float(np.abs(whole[2]) @ search.surface.half)
    bottom = float(pose[2, 3]) - height
    rests = abs(bottom - search.measured_box_bottom) < CONFIG.rests
    return pose_matrix(
        whole, np.array([pose[0, 3], pose[1, 3], (search.measured_box_bottom if rests else bottom) + height])
    )


def _refine_pose(
    pose: Array, cost_per_pose: Callable[[Array, int], Array], steps: Sequence[tuple[float, float]], factor: int
) -> Array:
    """Shift and turn about z in ever smaller steps for as long as it costs less, by one of ``factor`` samples."""
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
