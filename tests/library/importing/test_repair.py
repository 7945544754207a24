"""Repair of meshes."""

from typing import Any

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st

from grs_agents.library.importing.convex_decomposition import repair_mesh
from grs_agents.library.importing.types import AtlasMesh, Ints
from grs_agents.library.mesh_files import mesh_volume

SPHERE: Any = trimesh.creation.icosphere(2, 0.05)


def solid(faces: Ints) -> AtlasMesh:
    """Faces over the sphere's vertices, with a coordinate for each corner."""
    uvs = np.random.default_rng(0).uniform(size=(len(faces), 3, 2))
    return AtlasMesh(np.asarray(SPHERE.vertices, np.float64), faces, uvs, np.zeros((4, 4, 3), np.uint8))


@settings(max_examples=25, deadline=None)
@given(st.sets(st.integers(0, 319), max_size=150), st.integers(0, 319) | st.none(), st.booleans())
def test_turned_lost_and_duplicate_faces_are_repaired(turned: set[int], lost: int | None, twice: bool) -> None:
    faces = np.asarray(SPHERE.faces, np.int64).copy()
    for index in turned:
        faces[index] = faces[index, ::-1]
    if lost is not None:
        faces = np.delete(faces, lost, axis=0)
    if twice:
        faces = np.concatenate([faces, faces[:5], [[0, 0, 1]]])
    repaired, watertight, _ = repair_mesh(solid(faces))
    mesh: Any = trimesh.Trimesh(repaired.vertices, repaired.faces, process=False)
    assert watertight and mesh.is_volume
    assert mesh_volume(repaired.vertices, repaired.faces) == pytest.approx(SPHERE.volume, rel=1e-6)
    assert repaired.uvs.shape == (len(repaired.faces), 3, 2)


def test_coordinates_turn_with_their_face() -> None:
    faces = np.asarray(SPHERE.faces, np.int64).copy()
    faces[7] = faces[7, ::-1]
    before = solid(faces)
    repaired, _, _ = repair_mesh(before)
    at, after = (
        {int(corner): tuple(uv) for corner, uv in zip(mesh.faces[7], mesh.uvs[7], strict=True)}
        for mesh in (before, repaired)
    )
    assert at == after


def test_an_opening_stays_an_opening() -> None:
    pipe: Any = trimesh.creation.cylinder(0.05, 0.1, sections=300)
    sides = np.abs(pipe.face_normals[:, 2]) < 0.5
    faces = np.asarray(pipe.faces, np.int64)[sides]
    uvs = np.zeros((len(faces), 3, 2))
    _, watertight, notes = repair_mesh(
        AtlasMesh(np.asarray(pipe.vertices, np.float64), faces, uvs, np.zeros((2, 2, 3), np.uint8))
    )
    assert not watertight and "not watertight" in notes[-1]
