"""Mesh repair by trimesh, then the convex hulls and convex parts that collide."""

import importlib
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import trimesh

from grs_agents.library.importing.engine import load_mujoco
from grs_agents.library.importing.simplification import simplified
from grs_agents.library.importing.types import Floats, Hull, Ints, RefusedError, Solid


@dataclass(frozen=True)
class RepairedMesh:
    """A mesh after repair.

    Attributes:
        solid: the mesh.
        watertight: every edge has exactly two faces that agree on the outside.
        notes: what was done.
    """

    solid: Solid
    watertight: bool
    notes: tuple[str, ...]


def repair_mesh(solid: Solid) -> RepairedMesh:
    """Drop degenerate and duplicate faces, make the winding consistent, close holes of three or four edges.

    A larger hole stays open: it may be an opening that the object has. Winding and holes need ``networkx``, which the
    extra ``assets`` installs; without it the mesh stays as it is, and a note says so.
    """
    kept = _valid_faces(solid.faces)
    notes = [f"{dropped} degenerate or duplicate faces dropped"] if (dropped := len(solid.faces) - len(kept)) else []
    faces, uvs = solid.faces[kept], solid.uvs[kept]
    mesh = _mesh(solid.vertices, faces)
    if not mesh.is_volume:
        try:
            trimesh.repair.fix_winding(mesh)
            trimesh.repair.fill_holes(mesh)
        except ImportError:
            notes.append('winding and holes are not repaired: pip install "grs-agents[assets]"')
    repaired: Ints = np.asarray(mesh.faces, np.int64)
    turned = (repaired[: len(faces)] != faces).any(axis=1)
    if turned.any():
        notes.append(f"{int(turned.sum())} faces turned the right way out")
        uvs = np.where(turned[:, None, None], uvs[:, ::-1], uvs)
    if len(repaired) > len(faces):
        notes.append(f"holes closed with {len(repaired) - len(faces)} faces")
        uvs = np.concatenate([uvs, _texture_of_new_faces(repaired, uvs, len(faces))])
    if volume(solid.vertices, repaired) < 0:
        repaired, uvs = repaired[:, ::-1], uvs[:, ::-1]
        notes.append("it was inside out")
    watertight = bool(mesh.is_watertight and mesh.is_winding_consistent)
    if not watertight:
        notes.append("not watertight: its volume is that of its convex parts")
    return RepairedMesh(Solid(solid.vertices, repaired, uvs, solid.image), watertight, tuple(notes))


def volume(vertices: Floats, faces: Ints) -> float:
    """m^3 of a closed mesh, of an open one as seen from its middle; negative where the faces look inwards."""
    return float(_mesh(vertices - vertices.mean(axis=0), faces).volume)


def area(vertices: Floats, faces: Ints) -> float:
    """m^2."""
    return float(_mesh(vertices, faces).area)


def _mesh(vertices: Floats, faces: Ints) -> Any:
    return trimesh.Trimesh(vertices, faces, process=False)


def _valid_faces(faces: Ints) -> Ints:
    """Indices of the faces with three different corners, the first of each that occurs more than once."""
    distinct = (faces[:, 0] != faces[:, 1]) & (faces[:, 1] != faces[:, 2]) & (faces[:, 0] != faces[:, 2])
    kept = np.flatnonzero(distinct)
    _, first = np.unique(np.sort(faces[kept], axis=1), axis=0, return_index=True)
    return kept[np.sort(first)]


def _texture_of_new_faces(faces: Ints, uvs: Floats, count: int) -> Floats:
    """Texture coordinates for the faces after the first ``count``: those a neighbour has at the first corner."""
    by_vertex = np.zeros((int(faces.max()) + 1, 2))
    by_vertex[faces[:count].ravel()] = uvs.reshape(-1, 2)
    return np.repeat(by_vertex[faces[count:, 0]][:, None], 3, axis=1)


CONVEX: Final = 0.85
"""A mesh that fills so much of its hull is taken for convex: a carton with its gable, a can with its sunken lid."""
_THRESHOLD: Final = 0.06
_FACES: Final = 1000
_EDGES: Final = 64
"""Vertices of a convex part."""


def hull_of(vertices: Floats, most: int = -1) -> Hull:
    """The convex hull of points, as MuJoCo makes it.

    Args:
        vertices: (N, 3) m.
        most: vertices of the hull, about; -1 for all.

    Raises:
        RefusedError: the points lie in one plane.
    """
    mujoco = load_mujoco()
    low, extent = vertices.min(axis=0), float(np.ptp(vertices, axis=0).max()) or 1.0
    spec = mujoco.MjSpec()
    unit = _distinct((vertices - low) / extent)
    if len(unit) < 4 or float(np.linalg.svd(unit - unit.mean(axis=0), compute_uv=False)[-1]) < 1e-4:
        raise RefusedError("it has no volume: all its points lie in one plane", "give a solid thing")
    mesh = spec.add_mesh(name="hull", uservert=unit.ravel().tolist(), userface=_fan(len(unit)))
    mesh.inertia, mesh.needsdf = mujoco.mjtMeshInertia.mjMESH_INERTIA_CONVEX, False
    mesh.maxhullvert = max(4, most) if most > 0 else -1
    geom = spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_MESH)
    geom.meshname = "hull"
    try:
        model = spec.compile()
    except ValueError as error:
        raise RefusedError(f"it has no volume: {str(error).splitlines()[0]}", "give a solid thing") from error
    return _hull(model, mujoco, low, extent)


def _distinct(points: Floats) -> Floats:
    rounded: Any = np.round(points, 7)
    return np.asarray(np.unique(rounded, axis=0), np.float64)


def hull_volume(hull: Hull) -> float:
    """m^3."""
    return abs(volume(hull.vertices, hull.faces))


def _fan(count: int) -> list[int]:
    """Faces that use every vertex; the hull does not depend on them."""
    return [index for number in range(1, count - 1) for index in (0, number, number + 1)]


def _hull(model: Any, mujoco: Any, low: Floats, extent: float) -> Hull:
    graph = np.asarray(model.mesh_graph)[int(model.mesh_graphadr[0]) :]
    count, faces = int(graph[0]), int(graph[1])
    ids = graph[2 + count : 2 + 2 * count]
    triangles = graph[2 + 2 * count + count + 3 * faces :][: 3 * faces].reshape(-1, 3)
    points = np.asarray(model.mesh_vert, np.float64)[ids]
    number = np.full(int(ids.max()) + 1, -1, np.int64)
    number[ids] = np.arange(count)
    turn = np.empty(9)
    mujoco.mju_quat2Mat(turn, np.asarray(model.mesh_quat[0], np.float64))
    placed = points @ turn.reshape(3, 3).T + np.asarray(model.mesh_pos[0])
    index = number[triangles]
    if volume(placed, index) < 0:
        index = index[:, ::-1]
    return Hull(placed * extent + low, index)


def convex_parts(vertices: Floats, faces: Ints, watertight: bool, most: int) -> tuple[list[Hull], list[str]]:
    """The convex parts of a solid, and notes; one hull where it is nearly convex or ``coacd`` is not installed.

    Raises:
        RefusedError: it has no volume.
    """
    whole = hull_of(vertices, _EDGES)
    if watertight and volume(vertices, faces) >= CONVEX * hull_volume(whole):
        return [whole], []
    try:
        coacd: Any = importlib.import_module("coacd")
    except ImportError:
        return [whole], ['collides as its convex hull: parts need pip install "grs-agents[assets]"']
    points, triangles = simplified(vertices, faces, _FACES)
    coacd.set_log_level("error")
    found = coacd.run_coacd(
        coacd.Mesh(points, triangles.astype(np.int32)),
        threshold=_THRESHOLD, max_convex_hull=most, preprocess_resolution=30, resolution=300,
        mcts_nodes=8, mcts_iterations=10, mcts_max_depth=2, decimate=True, max_ch_vertex=_EDGES, seed=0,
    )  # fmt: skip
    parts: list[Hull] = []
    for corners, _ in found:
        try:
            parts.append(hull_of(np.asarray(corners, np.float64), _EDGES))
        except RefusedError:
            continue  # a splinter without volume
    return (parts, []) if parts else ([whole], ["collides as its convex hull: its parts have no volume"])
