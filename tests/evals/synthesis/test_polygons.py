"""Tiling polygons."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from evals.synthesis.meshes import annulus, prism
from evals.synthesis.polygons import area, convex_pieces, triangulate


@settings(max_examples=40, deadline=None)
@given(st.lists(st.floats(0.3, 3.0), min_size=3, max_size=14))
def test_any_star_shaped_polygon_is_tiled_exactly(radii: list[float]) -> None:
    angles = 2 * math.pi * np.arange(len(radii)) / len(radii)
    outline = np.array(radii)[:, None] * np.stack([np.cos(angles), np.sin(angles)], axis=1)
    triangles = triangulate(outline)
    assert len(triangles) == len(radii) - 2
    assert sum(area(outline[list(corners)]) for corners in triangles) == pytest.approx(area(outline))
    pieces = convex_pieces(outline)
    assert len(pieces) <= len(triangles)
    assert sum(area(piece) for piece in pieces) == pytest.approx(area(outline))
    solid = prism(outline, -1.0, 1.5).solid()
    assert solid.is_watertight
    assert solid.volume == pytest.approx(2.5 * area(outline))


def test_a_convex_polygon_is_one_piece() -> None:
    square = np.array([[0.0, 0], [1, 0], [1, 1], [0, 1]])
    assert len(convex_pieces(square)) == 1


def test_a_ring_has_a_hole() -> None:
    square = np.array([[1.0, -1], [1, 1], [-1, 1], [-1, -1]])
    solid = annulus(2 * square, square, 0.0, 0.5).solid()
    assert solid.is_watertight
    assert solid.volume == pytest.approx(0.5 * (16 - 4))
    assert solid.euler_number == 0
