"""Triangles of placed assets."""

import numpy as np
import pytest

from grs_agents.library.library import Library
from grs_agents.library.posed_meshes import build_posed_triangles, compute_smooth_normals
from grs_agents.library.shapes import IDENTITY_PLACEMENT


def test_things_stand_where_they_are_placed() -> None:
    library = Library()
    turned = (0.0, 0.0, np.sin(np.pi / 4), np.cos(np.pi / 4))
    posed = [("HOPE/Milk.urdf", ((0.4, -0.1, 0.095), turned)), ("cylinder/cylinder-template.urdf", IDENTITY_PLACEMENT)]
    triangles = build_posed_triangles(posed, library)
    milk = triangles.corners[triangles.owner == 1].reshape(-1, 3)
    low, high = milk.min(axis=0), milk.max(axis=0)
    assert low[2] == pytest.approx(0, abs=1e-6)
    assert (low + high)[:2] / 2 == pytest.approx((0.4, -0.1), abs=1e-6)
    assert high - low == pytest.approx((0.072, 0.073, 0.19), abs=1e-5)
    assert set(triangles.texture[triangles.owner == 1]) == {0}
    assert set(triangles.texture[triangles.owner == 2]) == {-1}
    assert len(triangles.textures) == 1


def test_a_corner_is_sharp_and_a_bend_is_smooth() -> None:
    flat = np.array([[(0, 0, 0), (1, 0, 0), (0, 1, 0)]], dtype=float)
    wall = np.array([[(0, 0, 0), (0, 0, -1), (1, 0, 0)]], dtype=float)
    assert np.allclose(compute_smooth_normals(np.concatenate([flat, wall]))[0], (0, 0, 1))
    slope = np.array([[(0, 0, 0), (0, -1, -0.3), (1, 0, 0)]], dtype=float)
    assert compute_smooth_normals(np.concatenate([flat, slope]))[0, 0, 1] < -0.05
