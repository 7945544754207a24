"""The even mesh of the unit sphere."""

import numpy as np
import pytest

from grs_agents.base.geometry.spheres import icosphere


@pytest.mark.parametrize("subdivisions", range(4))
def test_a_sphere_is_closed_even_and_turned_outwards(subdivisions: int) -> None:
    vertices, faces = icosphere(subdivisions)
    assert len(faces) == 20 * 4**subdivisions and len(vertices) == 2 + len(faces) // 2  # Euler
    assert np.allclose(np.linalg.norm(vertices, axis=1), 1)
    directed = {(int(a), int(b)) for face in faces for a, b in zip(face, np.roll(face, -1), strict=True)}
    assert len(directed) == 3 * len(faces) and all((b, a) in directed for a, b in directed)
    assert (np.linalg.det(vertices[faces]) > 0).all()
    lengths = np.linalg.norm(vertices[faces] - np.roll(vertices[faces], 1, axis=1), axis=2)
    assert lengths.max() / lengths.min() < 1.25
