"""Mesh repair by trimesh: faces without area, duplicate faces, faces that are inside out, small holes."""

from dataclasses import dataclass
from typing import Any

import numpy as np
import trimesh

from grs_agents.library.importing.types import Floats, Ints, Solid


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
