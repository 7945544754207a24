"""Footprints: hulls and hollow things."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

from grs_agents.perception.image_geometry import (
    compute_percentiles,
    convex_footprint_hull,
    label_connected_components,
    mask_bounding_slices,
    mask_outline_pixels,
    pixels_by_label,
    pixels_in_mask,
    points_in_hull_mask,
    values_in_mask,
)
from grs_agents.perception.segmentation.footprints import is_open_at_top, is_solid_object

POINTS = arrays.arrays(np.float64, st.tuples(st.integers(3, 40), st.just(2)), elements=st.floats(-1, 1, width=32))


@given(points=POINTS)
def test_every_point_is_inside_its_own_hull(points: np.ndarray) -> None:
    hull = convex_footprint_hull(points)
    if len(hull) >= 3:
        assert points_in_hull_mask(points, hull, margin=1e-5).all()


@given(points=POINTS, turn=st.floats(0, 6.28), shift=st.tuples(st.floats(-3, 3), st.floats(-3, 3)))
def test_insideness_moves_with_the_hull(points: np.ndarray, turn: float, shift: tuple[float, float]) -> None:
    square = np.array([(-0.5, -0.5), (0.5, -0.5), (0.5, 0.5), (-0.5, 0.5)])
    clear = np.abs(np.abs(points).max(axis=1) - 0.5) > 1e-6
    rotation = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
    moved = points_in_hull_mask(points @ rotation.T + shift, square @ rotation.T + shift, margin=0.0)
    assert (moved == points_in_hull_mask(points, square, margin=0.0))[clear].all()


def test_a_hull_of_two_corners_holds_nothing() -> None:
    assert not points_in_hull_mask(np.zeros((4, 2)), np.zeros((2, 2)), margin=1.0).any()


def test_components_below_the_bound_are_dropped() -> None:
    mask = np.zeros((10, 10), np.uint8)
    mask[1:4, 1:4] = mask[7, 7] = 1
    labels = label_connected_components(mask, 2)
    assert labels.max() == 1
    assert (labels > 0).sum() == 9


@given(labels=arrays.arrays(np.int32, st.tuples(st.integers(1, 9), st.integers(1, 9)), elements=st.integers(0, 5)))
def test_pixels_of_each_label_are_those_that_bear_it(labels: np.ndarray) -> None:
    pixels = pixels_by_label(labels)
    assert len(pixels) == labels.max()
    for label, own in enumerate(pixels, 1):
        assert (own == np.flatnonzero(labels == label)).all()


def test_values_window_and_outline_are_those_of_the_mask() -> None:
    mask = np.zeros((20, 30), np.bool_)
    mask[5:9, 7:17] = True
    picture = np.arange(20 * 30 * 3).reshape(20, 30, 3)
    assert (values_in_mask(picture, mask) == picture[mask]).all()
    assert mask_bounding_slices(mask) == (slice(5, 9), slice(7, 17))
    outline = mask_outline_pixels(mask)
    assert len(outline) == 2 * (4 + 10) - 4
    assert (outline.min(axis=0) == (7, 5)).all()
    assert (outline.max(axis=0) == (16, 8)).all()


@given(mask=arrays.arrays(np.bool_, st.tuples(st.integers(1, 9), st.integers(1, 9))))
def test_pixels_of_a_mask_and_their_window_are_those_of_numpy(mask: np.ndarray) -> None:
    rows, columns = pixels_in_mask(mask)
    assert (np.stack([rows, columns]) == np.stack(np.nonzero(mask))).all()
    window = mask_bounding_slices(mask)
    assert mask[window].sum() == mask.sum()
    assert mask[window].size == (np.ptp(rows) + 1) * (np.ptp(columns) + 1) if len(rows) else mask[window].size == 0


@given(mask=arrays.arrays(np.uint8, st.tuples(st.integers(1, 9), st.integers(1, 9)), elements=st.integers(0, 1)))
def test_large_components_keep_their_order(mask: np.ndarray) -> None:
    every = label_connected_components(mask, 1)
    large = [label for label in range(1, every.max() + 1) if (every == label).sum() >= 3]
    expected = sum(number * (every == label) for number, label in enumerate(large, 1))
    assert (label_connected_components(mask, 3) == expected).all()


@given(
    values=arrays.arrays(np.float64, st.tuples(st.integers(1, 30), st.integers(1, 3)), elements=st.floats(-9, 9)),
    shares=st.lists(st.floats(0, 100), min_size=1, max_size=3),
)
def test_percentiles_are_those_of_numpy(values: np.ndarray, shares: list[float]) -> None:
    assert np.allclose(compute_percentiles(values, shares), np.percentile(values, shares, axis=0), atol=1e-12)
    assert np.allclose(compute_percentiles(values[:, 0], shares), np.percentile(values[:, 0], shares), atol=1e-12)


def _grid(step: float = 0.004) -> np.ndarray:
    x, y = np.meshgrid(np.arange(-0.06, 0.061, step), np.arange(-0.06, 0.061, step))
    return np.stack([x.ravel(), y.ravel()], axis=1)


def test_a_bowl_is_open_and_a_lid_is_not() -> None:
    flat = _grid()
    radius = np.linalg.norm(flat, axis=1)
    flat, radius = flat[radius < 0.06], radius[radius < 0.06]
    bowl = np.column_stack([flat, 0.06 * (radius / 0.06) ** 2 + 0.005])
    assert is_open_at_top(bowl, np.zeros((0, 3)))
    assert not is_open_at_top(np.column_stack([flat, np.full(len(flat), 0.06)]), np.zeros((0, 3)))


def test_a_slope_is_not_open() -> None:
    flat = _grid()
    assert not is_open_at_top(np.column_stack([flat, 0.1 + flat[:, 0]]), np.zeros((0, 3)))


def test_what_is_highest_in_its_middle_is_solid_and_what_is_hollow_or_steep_is_not() -> None:
    x, y = (part.ravel() for part in np.meshgrid(np.linspace(-0.05, 0.05, 40), np.linspace(-0.04, 0.04, 32)))

    def solid(height: np.ndarray) -> bool:
        return is_solid_object(np.stack([x, y, np.broadcast_to(height, x.shape)], axis=1))

    assert solid(np.full_like(x, 0.06)), "the top of a box"
    assert solid(0.06 - 8 * (x**2 + y**2)), "a ball"
    assert not solid(0.03 + 8 * (x**2 + y**2)), "a bowl"
    assert not solid(np.full_like(x, 0.005)), "a floor"
    assert not solid(0.06 + 0.5 * x), "a slope"
    rim = np.hypot(x / 0.05, y / 0.04) > 0.8
    assert not is_solid_object(np.stack([x, y, np.full_like(x, 0.06)], axis=1)[rim]), "a rim"
