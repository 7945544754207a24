"""Mesh repair by trimesh, then the convex hulls and convex parts that collide."""

import importlib
from typing import Any, Final

import numpy as np
import trimesh

from grs_agents.library.importing.mesh_simplification import simplify_mesh
from grs_agents.library.importing.types import AtlasMesh, ConvexHull, Floats, Ints, RefusedError
from grs_agents.library.mesh_files import mesh_volume

CONVEX: Final = 0.85
"""Least share of the hull's volume for a mesh to count as convex: a carton with its gable, a can with its sunken
lid."""
_THRESHOLD: Final = 0.06
_MAX_FACES: Final = 1000
MAX_VERTICES: Final = 64
"""Largest number of vertices of a convex part."""


def repair_mesh(solid: AtlasMesh) -> tuple[AtlasMesh, bool, list[str]]:
    """Remove degenerate and duplicate faces and turn all faces outwards. Returns: the mesh, True if it is watertight,
    notes. Holes of three or four edges are closed; a larger hole may be an opening of the object. Winding and holes
    need ``networkx``, which the extra ``assets`` installs; without it the mesh stays as it is, and a note says so."""
    proper = np.flatnonzero(
        (solid.faces[:, 0] != solid.faces[:, 1])
        & (solid.faces[:, 1] != solid.faces[:, 2])
        & (solid.faces[:, 0] != solid.faces[:, 2])
    )
    _, first = np.unique(np.sort(solid.faces[proper], axis=1), axis=0, return_index=True)
    kept = proper[np.sort(first)]
    notes = [f"{dropped} degenerate or duplicate faces dropped"] if (dropped := len(solid.faces) - len(kept)) else []
    faces, uvs = solid.faces[kept], solid.uvs[kept]
    mesh: Any = trimesh.Trimesh(solid.vertices, faces, process=False)
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
        by_vertex = np.zeros((len(solid.vertices), 2))
        by_vertex[repaired[: len(faces)].ravel()] = uvs.reshape(-1, 2)
        new_uvs = by_vertex[repaired[len(faces) :, 0]]  # of a neighbour at the first corner
        uvs = np.concatenate([uvs, np.repeat(new_uvs[:, None], 3, axis=1)])
    if mesh_volume(solid.vertices, repaired) < 0:
        repaired, uvs = repaired[:, ::-1], uvs[:, ::-1]
        notes.append("it was inside out")
    watertight = bool(mesh.is_watertight and mesh.is_winding_consistent)
    if not watertight:
        notes.append("not watertight: its volume is that of its convex parts")
    return AtlasMesh(solid.vertices, repaired, uvs, solid.image), watertight, notes


def compute_convex_hull(vertices: Floats, max_vertices: int = -1) -> ConvexHull:
    """The convex hull of points (N, 3) by MuJoCo, with about ``max_vertices`` vertices (-1: all).

    At 64 vertices its hulls have 1 to 4 % more volume than those of SciPy with as many.
    """
    from grs_agents.base.mujoco_import import mujoco

    low, extent = vertices.min(axis=0), float(np.ptp(vertices, axis=0).max()) or 1.0
    scaled: Floats = (vertices - low) / extent
    unit: Floats = np.unique(scaled.round(7), axis=0)
    if len(unit) < 4 or float(np.linalg.svd(unit - unit.mean(axis=0), compute_uv=False)[-1]) < 1e-4:
        raise RefusedError("it has no volume: all its points lie in one plane", "give a solid thing")
    spec = mujoco.MjSpec()
    mesh = spec.add_mesh(name="hull", uservert=unit.ravel().tolist())
    mesh.inertia, mesh.needsdf = mujoco.mjtMeshInertia.mjMESH_INERTIA_CONVEX, False
    mesh.maxhullvert = max(4, max_vertices) if max_vertices > 0 else -1
    spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_MESH).meshname = "hull"
    try:
        graph = np.asarray(spec.compile().mesh_graph)
    except ValueError as error:
        raise RefusedError(f"it has no volume: {str(error).splitlines()[0]}", "give a solid thing") from error
    # MuJoCo's graph: two counts, an address for each vertex, the vertices, edges, and the faces last
    count, faces = int(graph[0]), int(graph[1])
    corners, triangles = graph[2 + count : 2 + 2 * count], graph[2 + 3 * count + 3 * faces :][: 3 * faces]
    number = np.full(len(unit), -1, np.int64)
    number[corners] = np.arange(count)
    return ConvexHull(unit[corners] * extent + low, number[triangles.reshape(-1, 3)])


def decompose_into_convex_parts(
    vertices: Floats, faces: Ints, watertight: bool, most: int
) -> tuple[list[ConvexHull], list[str]]:
    """The convex parts of a solid, and notes; a single hull if it is nearly convex or ``coacd`` is not installed."""
    whole = compute_convex_hull(vertices, MAX_VERTICES)
    if watertight and mesh_volume(vertices, faces) >= CONVEX * mesh_volume(whole.vertices, whole.faces):
        return [whole], []
    try:
        coacd: Any = importlib.import_module("coacd")
    except ImportError:
        return [whole], ['collides as its convex hull: parts need pip install "grs-agents[assets]"']
    points, triangles = simplify_mesh(vertices, faces, _MAX_FACES)
    settings = {"threshold": _THRESHOLD, "max_convex_hull": most, "max_ch_vertex": MAX_VERTICES, "decimate": True}
    resolution = {"preprocess_resolution": 30, "resolution": 300}
    search = {"mcts_nodes": 8, "mcts_iterations": 10, "mcts_max_depth": 2, "seed": 0}
    coacd.set_log_level("error")
    mesh = coacd.Mesh(points, triangles.astype(np.int32))
    parts: list[ConvexHull] = []
    for corners, _ in coacd.run_coacd(mesh, **settings, **resolution, **search):
        try:
            parts.append(compute_convex_hull(np.asarray(corners, np.float64), MAX_VERTICES))
        except RefusedError:
            continue  # a splinter without volume
    return (parts, []) if parts else ([whole], ["collides as its convex hull: its parts have no volume"])
