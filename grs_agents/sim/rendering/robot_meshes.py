"""A robot as it looks in triangles, for viewers that do not draw MuJoCo's models: one mesh for each of its bodies."""

from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from grs_agents.base.geometry.transforms import FloatArray
from grs_agents.base.mujoco_import import mujoco
from grs_agents.sim.arms.arm import Arm
from grs_agents.sim.rendering.stage import add_robot

_SLICES: Final = 24
_GEOM: Final = mujoco.mjtGeom


@dataclass(frozen=True)
class RobotMesh:
    """What is seen of one body, in its frame: N vertices of M triangles."""

    vertices: FloatArray  # (N, 3) metres
    normals: FloatArray  # (N, 3) unit length, outwards
    triangles: npt.NDArray[np.int64]  # (M, 3), counterclockwise from outside
    colors: npt.NDArray[np.uint8]  # (N, 4) red, green, blue, opacity


def build_robot_meshes(arm: Arm, push: bool = False) -> dict[str, RobotMesh]:
    """The meshes by the names of the bodies, "world" for what stands still; with the spatula to ``push``."""
    spec = mujoco.MjSpec()
    add_robot(spec, arm, push)
    model: Any = spec.compile()
    parts: dict[str, list[RobotMesh]] = {}
    for geom in np.flatnonzero(model.geom_rgba[:, 3] > 0).tolist():
        solid = _geom_triangles_and_normals(model, geom)
        if solid is None:
            continue
        turn = np.empty(9)
        mujoco.mju_quat2Mat(turn, model.geom_quat[geom])
        turn, (corners, normals) = turn.reshape(3, 3), solid
        count = len(corners)
        color = np.tile(np.round(255 * _geom_color(model, geom)).astype(np.uint8), (count, 1))
        mesh = RobotMesh(
            corners @ turn.T + model.geom_pos[geom], normals @ turn.T, np.arange(count).reshape(-1, 3), color
        )
        parts.setdefault(str(model.body(model.geom_bodyid[geom]).name), []).append(mesh)
    return {name: _merge_meshes(meshes) for name, meshes in parts.items()}


def _merge_meshes(meshes: list[RobotMesh]) -> RobotMesh:
    """One mesh of several, each corner a vertex of its own."""
    vertices, normals, colors = (
        np.concatenate([getattr(mesh, name) for mesh in meshes]) for name in ("vertices", "normals", "colors")
    )
    return RobotMesh(vertices, normals, np.arange(len(vertices)).reshape(-1, 3), colors)


def _geom_color(model: Any, geom: int) -> FloatArray:
    material = int(model.geom_matid[geom])
    return np.array(model.geom_rgba[geom] if material < 0 else model.mat_rgba[material], np.float64)


def _geom_triangles_and_normals(model: Any, geom: int) -> tuple[FloatArray, FloatArray] | None:
    """Corners (3 M, 3) of a geom's triangles in its own frame, m, and the normals there; None for endless planes."""
    kind, size = int(model.geom_type[geom]), model.geom_size[geom]
    if kind == _GEOM.mjGEOM_MESH:
        mesh = int(model.geom_dataid[geom])
        first, count = int(model.mesh_vertadr[mesh]), int(model.mesh_vertnum[mesh])
        start, faces = int(model.mesh_faceadr[mesh]), int(model.mesh_facenum[mesh])
        vertices = np.asarray(model.mesh_vert[first : first + count], np.float64)
        return _flat_shaded_triangles(vertices[model.mesh_face[start : start + faces]])
    if kind == _GEOM.mjGEOM_BOX:
        return _flat_shaded_triangles(_box_triangles() * size)
    if kind == _GEOM.mjGEOM_CYLINDER:
        return _cylinder_triangles(float(size[0]), float(size[1]))
    if kind in (_GEOM.mjGEOM_CAPSULE, _GEOM.mjGEOM_SPHERE):
        half = float(size[1]) if kind == _GEOM.mjGEOM_CAPSULE else 0.0
        return _revolve_about_z(_capsule_profile(float(size[0]), half))
    if kind == _GEOM.mjGEOM_ELLIPSOID:
        corners, normals = _revolve_about_z(_capsule_profile(1.0, 0.0))
        normals = normals / size
        return corners * size, normals / np.linalg.norm(normals, axis=1, keepdims=True)
    return None


def _flat_shaded_triangles(corners: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Of triangles (M, 3, 3), each as flat as it is."""
    across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    across /= np.maximum(np.linalg.norm(across, axis=1, keepdims=True), 1e-12)
    return corners.reshape(-1, 3), np.repeat(across, 3, axis=0)


def _box_triangles() -> FloatArray:
    """(12, 3, 3) of a box from -1 to 1."""
    faces = list[FloatArray]()
    for axis in range(3):
        for side in (-1.0, 1.0):
            square = np.zeros((4, 3))
            square[:, axis] = side
            square[:, [(axis + 1) % 3, (axis + 2) % 3]] = np.array([(-1, -1), (1, -1), (1, 1), (-1, 1)])
            faces += [square[[0, 1, 2]], square[[0, 2, 3]]] if side > 0 else [square[[0, 2, 1]], square[[0, 3, 2]]]
    return np.array(faces)


def _capsule_profile(radius: float, half: float) -> FloatArray:
    """(K, 4) distance from the axis and height, m, of a capsule from bottom to top, and the normal there."""
    angles = np.linspace(0.0, np.pi / 2, _SLICES // 4 + 1)
    sin, cos = np.sin(angles), np.cos(angles)
    top = np.column_stack([radius * cos, half + radius * sin, cos, sin])
    bottom = top[::-1] * (1, -1, 1, -1)
    return np.concatenate([bottom, top])


def _cylinder_triangles(radius: float, half: float) -> tuple[FloatArray, FloatArray]:
    """A cylinder with sharp edges."""
    profiles = (
        [(0, -half, 0, -1), (radius, -half, 0, -1)],
        [(radius, -half, 1, 0), (radius, half, 1, 0)],
        [(radius, half, 0, 1), (0, half, 0, 1)],
    )
    parts = [_revolve_about_z(np.array(profile, np.float64)) for profile in profiles]
    return np.concatenate([part[0] for part in parts]), np.concatenate([part[1] for part in parts])


def _revolve_about_z(profile: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Triangles of a profile (K, 4) turned about z."""
    angles = np.linspace(0.0, 2 * np.pi, _SLICES + 1)
    cos, sin = np.cos(angles), np.sin(angles)
    points = np.stack(
        [np.outer(profile[:, 0], cos), np.outer(profile[:, 0], sin), np.repeat(profile[:, 1:2], len(angles), 1)], -1
    )
    normals = np.stack(
        [np.outer(profile[:, 2], cos), np.outer(profile[:, 2], sin), np.repeat(profile[:, 3:4], len(angles), 1)], -1
    )
    corners = [(0, 0), (0, 1), (1, 1), (0, 0), (1, 1), (1, 0)]
    last, around = len(profile) - 1, _SLICES

    def triangle_corners_from_grid(grid: FloatArray) -> FloatArray:
        return np.stack([grid[i : i + last, j : j + around] for i, j in corners], axis=2).reshape(-1, 3)

    return triangle_corners_from_grid(points), triangle_corners_from_grid(normals)
