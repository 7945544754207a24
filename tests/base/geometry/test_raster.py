"""The z-buffer."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from grs_agents.base.geometry.raster import barycentric_coordinates, rasterise_triangles

NUMBERS = st.floats(-1, 1)


def test_the_nearer_triangle_hides_the_other_in_any_order() -> None:
    far = [(0, 0), (20, 0), (0, 20)]
    near = [(0, 0), (10, 0), (0, 10)]
    for order in ((0, 1), (1, 0)):
        corners = np.array([far, near], dtype=float)[list(order)]
        nearness = np.array([[1.0] * 3, [2.0] * 3])[list(order)]
        buffer = rasterise_triangles(corners, nearness, 24, 24)
        assert buffer.nearness[2, 2] == 2
        assert buffer.nearness[2, 14] == 1
        assert buffer.triangle[20, 20] == -1
        assert np.isneginf(buffer.nearness[20, 20])


def test_nearness_is_interpolated_and_the_picture_clips() -> None:
    corners = np.array([[(-10, 0), (10, 0), (0, 40)]], dtype=float)
    buffer = rasterise_triangles(corners, np.array([[0.0, 2.0, 1.0]]), 8, 8)
    assert np.isclose(buffer.nearness[0, 0], 1.0)
    assert np.isclose(buffer.nearness[0, 5], 1.5)


@settings(deadline=None, max_examples=50)
@given(st.integers(0, 2**32 - 1), st.sampled_from([1.0, 6.0, 40.0]), st.booleans())
def test_each_pixel_shows_the_nearest_triangle_that_covers_it(seed: int, size: float, whole: bool) -> None:
    rng = np.random.default_rng(seed)
    corners = rng.uniform(-5, 25, (12, 1, 2)) + rng.normal(0, size, (12, 3, 2))
    if whole:  # edges pass through pixels
        corners = corners.round()
    nearness = rng.uniform(1, 2, (12, 3))
    buffer = rasterise_triangles(corners, nearness, 20, 16)
    rows, columns = np.indices((16, 20), dtype=float)
    within, touched = np.full((16, 20), -np.inf), np.full((16, 20), -np.inf)  # on an edge rounding decides
    for triangle, near in zip(corners, nearness, strict=True):
        sides = [
            (end[0] - start[0]) * (rows - start[1]) - (end[1] - start[1]) * (columns - start[0])
            for start, end in zip(triangle, np.roll(triangle, -1, axis=0), strict=True)
        ]
        area = sum(sides)
        if np.abs(area).max() > 1e-9:
            weights = np.stack([sides[1], sides[2], sides[0]]) / area
            value = np.tensordot(near, weights, 1)
            within = np.where((weights >= 1e-9).all(axis=0), np.maximum(within, value), within)
            touched = np.where((weights >= -1e-9).all(axis=0), np.maximum(touched, value), touched)
    assert ((buffer.triangle >= 0) == np.isfinite(buffer.nearness)).all()
    assert (buffer.nearness >= within - 1e-9).all()
    assert (buffer.nearness <= touched + 1e-9).all()


@settings(deadline=None)
@given(st.lists(st.tuples(NUMBERS, NUMBERS, NUMBERS), min_size=3, max_size=3), st.floats(0, 1), st.floats(0, 1))
def test_barycentric_weights_give_the_point_back(corners: list[tuple[float, float, float]], u: float, v: float) -> None:
    triangle = np.array([corners])
    if np.linalg.norm(np.cross(triangle[0, 1] - triangle[0, 0], triangle[0, 2] - triangle[0, 0])) < 1e-2:
        return
    point = triangle[:, 0] + u * (triangle[:, 1] - triangle[:, 0]) + v * (triangle[:, 2] - triangle[:, 0])
    weights = barycentric_coordinates(point, triangle)
    assert np.allclose(weights.sum(axis=1), 1)
    assert np.allclose(np.einsum("ij,ijk->ik", weights, triangle), point, atol=1e-6)
