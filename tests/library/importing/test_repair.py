"""Mending meshes."""

from typing import Any

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st

from grs_agents.library.importing.repair import is_watertight, mend, volume
from grs_agents.library.importing.types import Ints, Solid

SPHERE: Any = trimesh.creation.icosphere(2, 0.05)


def solid(faces: Ints) -> Solid:
    """Faces over the sphere's vertices, with a coordinate for each corner."""
    uvs = np.random.default_rng(0).uniform(size=(len(faces), 3, 2))
    return Solid(np.asarray(SPHERE.vertices, np.float64), faces, uvs, np.zeros((4, 4, 3), np.uint8))


@settings(max_examples=25, deadline=None)
@given(st.sets(st.integers(0, 319), max_size=150), st.sets(st.integers(0, 319), max_size=6), st.booleans())
def test_turned_lost_and_doubled_faces_are_mended(turned: set[int], lost: set[int], twice: bool) -> None:
    faces = np.asarray(SPHERE.faces, np.int64).copy()
    for index in turned:
        faces[index] = faces[index, ::-1]
    faces = np.delete(faces, sorted(lost), axis=0)
    if twice:
        faces = np.concatenate([faces, faces[:5], [[0, 0, 1]]])
    mended = mend(solid(faces))
    assert mended.watertight and is_watertight(mended.solid.faces)
    assert volume(mended.solid.vertices, mended.solid.faces) == pytest.approx(SPHERE.volume, rel=0.06)
    assert mended.solid.uvs.shape == (len(mended.solid.faces), 3, 2)


def test_coordinates_turn_with_their_face() -> None:
    faces = np.asarray(SPHERE.faces, np.int64).copy()
    faces[7] = faces[7, ::-1]
    before = solid(faces)
    mended = mend(before).solid
    at, after = (
        {int(corner): tuple(uv) for corner, uv in zip(one.faces[7], one.uvs[7], strict=True)}
        for one in (before, mended)
    )
    assert at == after


def test_an_opening_stays_an_opening() -> None:
    pipe: Any = trimesh.creation.cylinder(0.05, 0.1, sections=300)
    sides = np.abs(pipe.face_normals[:, 2]) < 0.5
    faces = np.asarray(pipe.faces, np.int64)[sides]
    uvs = np.zeros((len(faces), 3, 2))
    mended = mend(Solid(np.asarray(pipe.vertices, np.float64), faces, uvs, np.zeros((2, 2, 3), np.uint8)))
    assert not mended.watertight and "not watertight" in mended.notes[-1]
