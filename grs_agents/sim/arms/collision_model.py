"""The part of a robot's file that collides: without visual geoms, its meshes reduced to convex hulls.

A simulation holds dozens of copies of its model, within the memory of a sandbox; meshes as in a file take 5 to 60 MiB
of each. MuJoCo collides with the hull of a mesh in any case.
"""

from itertools import count
from typing import Any, Final

import numpy as np

from grs_agents.base.geometry.transforms import FloatArray
from grs_agents.base.mujoco_import import mujoco

_DIRECTIONS: Final = 256
"""Of which each keeps the vertex of a hull that is farthest: the rest lies within 1 to 2 mm of a link's full hull."""


def reduce_to_collision_model(spec: Any) -> None:
    """Discard what does not collide from a robot's spec and reduce its meshes; inertias and poses stay.

    Raises ``ValueError`` as MuJoCo does if the spec does not compile.
    """
    spec.discard_visual()
    for body in spec.bodies[1:]:
        if not body.explicitinertial and any(geom.meshname for geom in body.geoms):
            spec.adopt_inertial(body)
    model = spec.compile()
    for geom in spec.geoms:
        if geom.meshname and geom.type != mujoco.mjtGeom.mjGEOM_MESH:  # a primitive fitted to the mesh
            number = int(geom.id)
            geom.meshname, geom.size = "", model.geom_size[number]
            geom.pos, geom.quat = model.geom_pos[number], model.geom_quat[number]
    meshes = {str(mesh.name): _hull_vertices(model, int(mesh.id)) for mesh in spec.meshes}
    free_names = (name for number in count() if (name := f"hull_{number}") not in meshes)
    hulls: dict[str, str] = {}
    for mesh, hull in meshes.items():
        if hull is not None:
            hulls[mesh] = next(free_names)
            inertia = mujoco.mjtMeshInertia.mjMESH_INERTIA_CONVEX
            spec.add_mesh(name=hulls[mesh], uservert=hull.ravel(), inertia=inertia)
    for geom in spec.geoms:
        geom.meshname = hulls.get(str(geom.meshname), geom.meshname)
    delete_unused_meshes(spec)
    mujoco.mj_clearCache(mujoco.mj_getCache())  # of the files' meshes, which are not read again


def delete_unused_meshes(spec: Any) -> None:
    """Delete the meshes of a spec that no geom has."""
    used = {str(geom.meshname) for geom in spec.geoms}
    for mesh in list(spec.meshes):
        if str(mesh.name) not in used:
            spec.delete(mesh)


def _hull_vertices(model: Any, mesh: int) -> Any:
    """Vertices (N, 3) of a mesh's hull in the frame of its file; None if MuJoCo made no hull."""
    start = int(model.mesh_graphadr[mesh])
    if start < 0:
        return None
    count = int(model.mesh_graph[start])
    indices = model.mesh_graph[start + 2 + count : start + 2 + 2 * count]
    rotation = np.empty(9)
    mujoco.mju_quat2Mat(rotation, model.mesh_quat[mesh])
    vertices = model.mesh_vert[int(model.mesh_vertadr[mesh]) + indices].astype(np.float64)
    farthest = np.unique((vertices @ _spread_directions(_DIRECTIONS).T).argmax(axis=0))
    return vertices[farthest] @ rotation.reshape(3, 3).T + model.mesh_pos[mesh]


def _spread_directions(count: int) -> FloatArray:
    """Unit vectors (N, 3) on a Fibonacci lattice."""
    steps = np.arange(count) + 0.5
    heights, turns = 1 - 2 * steps / count, np.pi * (1 + 5**0.5) * steps
    radii = np.sqrt(1 - heights**2)
    return np.column_stack([radii * np.cos(turns), radii * np.sin(turns), heights])
