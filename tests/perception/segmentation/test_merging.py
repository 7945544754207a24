"""Parts of one object are merged; neighbours are not."""

import numpy as np
import pytest

from grs_agents.perception.segmentation.part_merging import (
    gap_between_parts,
    measure_part,
    merge_parts,
    share_over_footprint,
)


def _plate(x: float, y: float, z: float, side: float = 0.05) -> np.ndarray:
    a, b = np.meshgrid(np.linspace(0, side, 20), np.linspace(0, side, 20))
    return np.stack([x + a, y + b, np.full_like(a, z)], axis=-1)


def _ring(inner: float, outer: float, low: float, high: float, rows: int) -> np.ndarray:
    """(rows, 60, 3) points between two circles, m, rising outwards from one height to another."""
    angle, share = np.meshgrid(np.linspace(0, 2 * np.pi, 60), np.linspace(0, 1, rows))
    radius = inner + (outer - inner) * share
    return np.stack([radius * np.cos(angle), radius * np.sin(angle), low + (high - low) * share], axis=-1)


def _labels(*pieces: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    labels = np.concatenate([np.full(piece.shape[:2], i, np.int32) for i, piece in enumerate(pieces, 1)])
    return labels, np.concatenate(pieces)


def _grey(labels: np.ndarray) -> np.ndarray:
    return np.full((*labels.shape, 3), 128, np.uint8)


def test_two_level_boxes_that_touch_stay_two() -> None:
    labels, points = _labels(_plate(0, 0, 0.1), _plate(0.05, 0, 0.1))
    assert len(np.unique(merge_parts(labels, points, _grey(labels)))) == 2


def test_the_near_and_far_half_of_a_bowl_are_one() -> None:
    angle, radius = np.meshgrid(np.linspace(0, 2 * np.pi, 60), np.linspace(0.03, 0.08, 20))
    height = 0.06 * ((radius - 0.03) / 0.05)
    points = np.stack([radius * np.cos(angle), radius * np.sin(angle), height + 0.01], axis=-1)
    labels = np.where(points[..., 0] > -0.02, 1, 2).astype(np.int32)
    assert len(np.unique(merge_parts(labels, points, _grey(labels)))) == 1


def test_a_floor_belongs_to_the_wall_around_it() -> None:
    labels, points = _labels(_ring(0.08, 0.09, 0.01, 0.08, 20), _ring(0.0, 0.075, 0.01, 0.01, 12))
    assert len(np.unique(merge_parts(labels, points, _grey(labels)))) == 1


def test_an_inner_wall_belongs_to_the_wall_around_it() -> None:
    labels, points = _labels(_ring(0.08, 0.09, 0.07, 0.08, 20), _ring(0.035, 0.045, 0.03, 0.064, 12))
    assert len(np.unique(merge_parts(labels, points, _grey(labels)))) == 1


def test_a_thing_in_a_tray_of_its_height_is_no_wall_of_it() -> None:
    x, back = np.meshgrid(np.linspace(-0.1, 0.1, 60), np.linspace(0.1, -0.1, 20))
    tray = np.stack([x, back, np.where(np.abs(x) > 0.07, 0.08, 0.02)], axis=-1)
    across, front = np.meshgrid(np.linspace(-0.08, 0.08, 60), np.linspace(-0.04, -0.075, 18))
    labels, points = _labels(tray, np.stack([across, front, np.full_like(across, 0.08)], axis=-1))
    assert len(np.unique(merge_parts(labels, points, _grey(labels)))) == 2


def test_a_small_cap_belongs_to_its_bottle() -> None:
    labels, points = _labels(*(_plate(0, 0, z) for z in (0.05, 0.08, 0.1)), _plate(0.02, 0.02, 0.11, side=0.01))
    labels[labels < 4] = 1
    assert len(np.unique(merge_parts(labels, points, _grey(labels)))) == 1


def test_a_box_on_a_box_stays() -> None:
    labels, points = _labels(_plate(0, 0, 0.05, 0.2), _plate(0.05, 0.05, 0.1, 0.08))
    assert len(np.unique(merge_parts(labels, points, _grey(labels)))) == 2


def test_gap_and_cover_of_two_plates() -> None:
    one, other = measure_part(_plate(0, 0, 0.1).reshape(-1, 3)), measure_part(_plate(0, 0, 0.13).reshape(-1, 3))
    assert one is not None
    assert other is not None
    assert gap_between_parts(one, other) == pytest.approx(0.03, abs=0.002)
    assert share_over_footprint(one, other) > 0.95


def test_a_handful_of_points_is_no_part() -> None:
    assert measure_part(np.full((100, 3), np.nan)) is None
