"""Convex hulls and convex parts: what collides."""

import importlib
from typing import Any, Final

import numpy as np

from grs_agents.library.importing.engine import load_mujoco
from grs_agents.library.importing.repair import volume
from grs_agents.library.importing.simplification import simplified
from grs_agents.library.importing.types import Floats, Hull, Ints, RefusedError

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
