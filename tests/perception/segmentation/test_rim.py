"""The rim of an open thing tells its place and width, whatever else of it is seen."""

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from grs_agents.perception.segmentation.footprints import fit_bowl_rim

Floats = npt.NDArray[np.float64]


def _bowl(center: tuple[float, float], radius: float, height: float, seen: tuple[float, float], noise: float) -> Floats:
    """(N, 3) points of the inside of a bowl between two bearings (rad), with noise (m)."""
    random = np.random.default_rng(7)
    bearing, level = random.uniform(*seen, 4000), random.uniform(0, 1, 4000) ** 0.5
    reach = radius * (0.6 + 0.4 * level)
    points = np.stack([reach * np.cos(bearing), reach * np.sin(bearing), height * level], axis=1)
    return points + np.array([*center, 0.0]) + random.normal(0, noise, points.shape)


def _box(length: float, width: float, height: float) -> Floats:
    """(N, 3) points of the walls of an open box."""
    random = np.random.default_rng(7)
    along, level = random.uniform(-0.5, 0.5, (2, 4000)) * [[1], [height]]
    walls = [(along * length, np.full(4000, side * width / 2)) for side in (-1, 1)]
    walls += [(np.full(4000, side * length / 2), along * width) for side in (-1, 1)]
    return np.concatenate([np.stack([x, y, level + height / 2], axis=1) for x, y in walls])


@given(
    center=st.tuples(st.floats(-0.5, 0.5), st.floats(-0.5, 0.5)),
    radius=st.floats(0.055, 0.12),
    begin=st.floats(0, 2 * np.pi),
    seen=st.floats(0.75, 1.0),
    noise=st.floats(0, 0.001),
)
@settings(max_examples=40)
def test_a_bowl_is_found_by_its_rim_though_a_part_of_it_is_hidden(
    center: tuple[float, float], radius: float, begin: float, seen: float, noise: float
) -> None:
    found = fit_bowl_rim(_bowl(center, radius, 0.06, (begin, begin + seen * 2 * np.pi), noise))
    assert found is not None
    assert found[0] == pytest.approx(center, abs=0.003)
    assert found[1] == pytest.approx(2 * radius, abs=0.006)


def test_strays_behind_a_bowl_shift_it_little() -> None:
    """Where a sensor mixes the far rim with the table behind it, points lie low and beyond."""
    bowl = _bowl((0.4, 0.1), 0.07, 0.05, (0, 2 * np.pi), 0.001)
    strays = np.random.default_rng(3).uniform((0.49, 0.06, 0.001), (0.52, 0.14, 0.02), (200, 3))
    found = fit_bowl_rim(np.concatenate([bowl, strays]))
    assert found is not None and found[0] == pytest.approx((0.4, 0.1), abs=0.003)


def test_a_pan_is_more_than_its_rim() -> None:
    pan = _bowl((0.4, 0.1), 0.07, 0.05, (0, 2 * np.pi), 0.001)
    handle = np.random.default_rng(3).uniform((0.47, 0.09, 0.035), (0.6, 0.11, 0.045), (300, 3))
    assert fit_bowl_rim(np.concatenate([pan, handle])) is None


def test_a_cup_is_measured_by_its_side() -> None:
    assert fit_bowl_rim(_bowl((0.4, 0.1), 0.04, 0.09, (0, 2 * np.pi), 0.001)) is None


@pytest.mark.parametrize("sides", [(0.1, 0.1), (0.15, 0.1), (0.3, 0.2)])
def test_the_rim_of_an_open_box_is_not_round(sides: tuple[float, float]) -> None:
    assert fit_bowl_rim(_box(*sides, 0.08)) is None


def test_half_a_rim_is_too_little() -> None:
    assert fit_bowl_rim(_bowl((0.0, 0.0), 0.07, 0.05, (0, np.pi), 0.001)) is None


def test_a_few_points_are_too_few() -> None:
    assert fit_bowl_rim(_bowl((0.0, 0.0), 0.07, 0.05, (0, 2 * np.pi), 0.0)[:60]) is None
