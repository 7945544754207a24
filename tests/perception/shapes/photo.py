"""Views of known solids on a table, cast without noise and without any graphics library."""

import numpy as np
import trimesh

from grs_agents.base.geometry.raster import rasterise_triangles
from grs_agents.perception.shapes.types import ObjectView
from grs_agents.perception.types import Intrinsics

CAMERA = Intrinsics(fx=520.0, fy=520.0, cx=159.5, cy=119.5, width=320, height=240)


def pose_looking_down(tilt, distance, target=(0.0, 0.0, 0.04)):
    """Camera pose (4, 4) that looks at a place along x, ``tilt`` rad down."""
    forward = np.array([np.cos(tilt), 0, -np.sin(tilt)])
    right = np.array([0.0, -1.0, 0.0])
    pose = np.eye(4)
    pose[:3, :3] = np.stack([right, np.cross(forward, right), forward], axis=1)
    pose[:3, 3] = np.array(target) - distance * forward
    return pose


def depth_of(mesh, pose):
    """(H, W) depth of a mesh, infinite where there is none."""
    local = (np.asarray(mesh.vertices) - pose[:3, 3]) @ pose[:3, :3]
    flat = local[:, :2] / local[:, 2:] * (CAMERA.fx, CAMERA.fy) + (CAMERA.cx, CAMERA.cy)
    faces = np.asarray(mesh.faces)
    buffer = rasterise_triangles(flat[faces], (1 / local[:, 2])[faces], CAMERA.width, CAMERA.height)
    return np.where(buffer.triangle >= 0, 1 / np.where(buffer.triangle >= 0, buffer.nearness, 1), np.inf)


def depth_of_table(pose):
    """(H, W) depth of the table top, z = 0, alone."""
    rows, columns = np.indices((CAMERA.height, CAMERA.width))
    across, down = (columns - CAMERA.cx) / CAMERA.fx, (rows - CAMERA.cy) / CAMERA.fy
    return -pose[2, 3] / (np.stack([across, down, np.ones_like(across)], axis=-1) @ pose[2, :3])


def photograph(mesh, tilt=0.7, distance=0.6, noise=0.0, before=None, rng=None):
    """The view of a solid on a wooden table; ``before`` is a solid that hides part of it."""
    pose = pose_looking_down(tilt, distance)
    table = trimesh.creation.box((3, 3, 0.01))
    table.apply_translation((0, 0, -0.005))
    own, other = depth_of(mesh, pose), depth_of(table, pose)
    front = np.full_like(own, np.inf) if before is None else depth_of(before, pose)
    mask = (own < other) & (own < front)
    depth = np.minimum(np.minimum(own, other), front)
    depth = np.where(np.isfinite(depth), depth, 0)
    if rng is not None:
        depth = depth + rng.normal(0, noise, depth.shape)
    rgb = np.full((*depth.shape, 3), (140, 90, 60), np.uint8)
    rgb[mask] = (30, 60, 200)
    x, y, z = (float(side) for side in np.ptp(mesh.vertices, axis=0))
    return ObjectView(rgb, depth.astype(np.float32), mask, CAMERA, pose, (x, y, z), max(noise, 0.0012))


def cup(radius=0.04, height=0.1, wall=0.004):
    """An open cup that stands on the table."""
    profile = [(0, 0), (radius, 0), (radius, height), (radius - wall, height), (radius - wall, wall), (0, wall)]
    return trimesh.creation.revolve(np.array(profile), sections=64)


def on_table(mesh):
    """The mesh lifted to stand on the table, its middle over the origin."""
    low, high = mesh.bounds
    mesh.apply_translation((-(low[0] + high[0]) / 2, -(low[1] + high[1]) / 2, -low[2]))
    return mesh
