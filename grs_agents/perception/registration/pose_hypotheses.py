"""Where a registration may begin: every side of the asset up, and its sides on the planes that are seen."""

import math
from functools import lru_cache

import numpy as np

from grs_agents.base.geometry.transforms import pose_matrix, rotation_about_z
from grs_agents.perception.asset_surfaces import Symmetry, cube_rotation_matrices
from grs_agents.perception.configuration import DEFAULT
from grs_agents.perception.registration.pose_cost import ObservedPoints
from grs_agents.perception.types import Array, UprightBox

CONFIG = DEFAULT.registration.hypotheses


def propose_initial_poses(
    half: Array, symmetry: Symmetry, upright: UprightBox, seen: ObservedPoints, normals: Array
) -> Array:
    """(K, 4, 4) poses worth a try, each look of the asset once for each frame that it may be in.
    ``half`` are half the asset's extents (3,), m; ``normals`` (N, 3) are unit, at the points of ``seen``."""
    turns = _distinct_quarter_turns(symmetry.turns.tobytes(), symmetry.axes.tobytes())
    bottom, top = (upright.center[2] + side * upright.size[2] / 2 for side in (-1, 1))
    poses: list[Array] = []
    for between in (0.0, math.pi / 4):
        for turn in turns:
            whole = rotation_about_z(upright.yaw + between) @ turn
            height = float(np.abs(turn[2]) @ half)
            poses.append(pose_matrix(whole, np.array([*upright.center[:2], bottom + height])))
            if top - height > bottom + height / 5:  # its bottom may be hidden: what is seen of it is its top
                poses.append(pose_matrix(whole, np.array([*upright.center[:2], top - height])))
    frame = estimate_leaning_axes(seen, normals)
    if frame is not None:
        poses += [pose_matrix(frame @ turn, _center_behind_points(frame, np.abs(turn) @ half, seen)) for turn in turns]
    return np.stack(poses)


def propose_shifted_poses(poses: Array, half: Array, seen: ObservedPoints) -> Array:
    """More (K, 4, 4) poses: where a part is hidden, what is seen may be either end of the asset."""
    slid: list[Array] = []
    for pose in poses:
        low, high = np.percentile((seen.points - pose[:3, 3]) @ pose[:3, :3], (2, 98), axis=0)
        for axis in range(3):
            if abs(2 * half[axis] - (high - low)[axis]) < CONFIG.hidden or abs(pose[2, axis]) > 0.7:
                continue
            for shift in (low[axis] + half[axis], high[axis] - half[axis]):
                slid.append(pose_matrix(pose[:3, :3], pose[:3, 3] + shift * pose[:3, axis]))
    return np.stack(slid) if slid else poses[:0]


@lru_cache(maxsize=128)
def _distinct_quarter_turns(turns: bytes, axes: bytes) -> tuple[Array, ...]:
    """The quarter turns of which no two look alike."""
    symmetry = Symmetry(np.frombuffer(turns).reshape(-1, 3, 3), np.frombuffer(axes).reshape(-1, 3))
    tried: list[Array] = []
    for turn in cube_rotation_matrices():
        if all(symmetry.rotation_error_degrees(turn, other) >= 1.0 for other in tried):
            tried.append(turn)
    return tuple(tried)


def estimate_leaning_axes(seen: ObservedPoints, normals: Array) -> Array | None:
    """(3, 3) axes of an object that leans: its largest plane's normal, that of one across it, and the third.
    ``None`` where a normal is vertical, as it is for what stands upright."""
    outwards = normals * -np.sign(np.einsum("ni,ni->n", normals, seen.points - seen.camera_position))[:, None]
    alike = outwards @ outwards.T > math.cos(CONFIG.same_plane)
    first = _mean_normal(outwards, alike[int(alike.sum(axis=1).argmax())])
    across = np.abs(outwards @ first) < math.sin(CONFIG.same_plane)
    counts = (alike & across[:, None] & across).sum(axis=1)
    most = int(counts.argmax())
    if counts[most] > CONFIG.second_plane * len(outwards):
        second = _mean_normal(outwards, alike[most] & across)
        second -= (second @ first) * first
    else:  # its longer side lies in the plane
        flat = seen.points - seen.points.mean(axis=0)
        flat -= np.outer(flat @ first, first)
        second = np.linalg.svd(flat, full_matrices=False)[2][0]
    second /= np.linalg.norm(second)
    axes = np.stack([second, np.cross(first, second), first], axis=1)
    return None if np.abs(axes[2]).max() > math.cos(CONFIG.level) else axes


def _mean_normal(normals: Array, chosen: Array) -> Array:
    total = normals[np.asarray(chosen, np.bool_)].sum(axis=0)
    return total / max(float(np.linalg.norm(total)), 1e-9)


def _center_behind_points(axes: Array, half: Array, seen: ObservedPoints) -> Array:
    """Where the middle of a box of ``half`` extents along ``axes`` is whose nearer sides are the outermost points."""
    low, high = np.percentile(seen.points @ axes, (2, 98), axis=0)
    to_eye = (seen.camera_position - seen.points.mean(axis=0)) @ axes
    far = float(np.linalg.norm(to_eye))
    middle = (low + high) / 2
    near, away = to_eye > CONFIG.oblique * far, to_eye < -CONFIG.oblique * far
    middle[near], middle[away] = (high - half)[near], (low + half)[away]
    return np.asarray(axes @ middle, np.float64)
