"""Pieces of one thing behind another are joined; neighbours are not."""

from dataclasses import replace

import numpy as np
import pytest

from grs_agents.perception.segmentation.piece_joining import join_occluded_pieces
from grs_agents.perception.table_finding import find_table, robot_frame_point_map
from grs_agents.perception.types import RGBDFrame
from tests.perception.conftest import Thing, render


@pytest.fixture(scope="module")
def barred() -> tuple[RGBDFrame, np.ndarray]:
    """A flat box on which a bar lies from front to back, with a label for each side of it."""
    scene = render(
        (Thing("box", (0.5, 0.0), (0.2, 0.28, 0.04)), Thing("box", (0.5, 0.0), (0.3, 0.05, 0.06), bottom=0.04))
    )
    columns = np.indices(scene.labels.shape)[1]
    return scene.frame, np.where((scene.labels == 1) & (columns > columns.shape[1] // 2), 3, scene.labels).astype(
        np.int32
    )


def _joined(frame: RGBDFrame, labels: np.ndarray) -> np.ndarray:
    return join_occluded_pieces(
        labels, frame, robot_frame_point_map(frame, find_table(frame, np.random.default_rng(0)))
    )


def test_the_sides_of_a_barred_box_are_one(barred: tuple[RGBDFrame, np.ndarray]) -> None:
    frame, labels = barred
    joined = _joined(frame, labels)
    assert joined.max() == 2
    assert len(np.unique(joined[(labels == 1) | (labels == 3)])) == 1
    assert (joined == 0)[labels == 0].all()


@pytest.mark.parametrize(("shade", "whole"), [(0.55, True), (0.3, False)])
def test_sides_of_one_rectangle_may_lie_in_different_light(
    barred: tuple[RGBDFrame, np.ndarray], shade: float, whole: bool
) -> None:
    frame, labels = barred
    rgb = frame.rgb.copy()
    rgb[labels == 1], rgb[labels == 3] = (200, 160, 120), (shade * np.array((200, 160, 120))).astype(np.uint8)
    assert int(_joined(replace(frame, rgb=rgb), labels).max()) == (2 if whole else 3)


def test_sides_behind_two_things_are_one(barred: tuple[RGBDFrame, np.ndarray]) -> None:
    frame, labels = barred
    columns = np.indices(labels.shape)[1]
    middle = int(np.median(columns[labels == 2]))
    halves = np.where((labels == 2) & (columns > middle), 4, labels).astype(np.int32)
    joined = _joined(frame, halves)
    assert joined.max() == 3
    assert len(np.unique(joined[(labels == 1) | (labels == 3)])) == 1


def test_sides_of_different_colour_stay_two(barred: tuple[RGBDFrame, np.ndarray]) -> None:
    frame, labels = barred
    rgb = frame.rgb.copy()
    rgb[labels == 1], rgb[labels == 3] = (200, 40, 40), (40, 40, 200)
    assert _joined(replace(frame, rgb=rgb), labels).max() == 3


def test_sides_with_nothing_before_them_stay_two(barred: tuple[RGBDFrame, np.ndarray]) -> None:
    frame, labels = barred
    assert _joined(frame, np.array([0, 1, 0, 2], np.int32)[labels]).max() == 2


def test_no_segments_are_no_segments(barred: tuple[RGBDFrame, np.ndarray]) -> None:
    frame, labels = barred
    assert _joined(frame, np.zeros_like(labels)).max() == 0


def _bar_with_a_band(gap: float, shift: float = 0.0) -> tuple[RGBDFrame, np.ndarray]:
    """A lying bar, printed all along, with a band (m) around its middle that has no depth, and a label for each side;
    the right side is so much (m) nearer to the camera."""
    scene = render((Thing("box", (0.5, 0.0), (0.05, 0.2, 0.06)),), noise=0.0005)
    depth, rgb, columns = scene.frame.depth.copy(), scene.frame.rgb.copy(), np.indices(scene.labels.shape)[1]
    bar = scene.labels == 1
    middle = int(np.median(columns[bar]))
    half = int(gap / 2 * scene.frame.camera.fx / np.median(depth[bar]))
    band = bar & (np.abs(columns - middle) <= half)
    rgb[bar & (columns % 6 < 3)] = (200, 60, 40)
    depth[bar & (columns > middle)] -= shift
    depth[band] = 0
    labels = np.where(bar & ~band, np.where(columns > middle, 2, 1), 0).astype(np.int32)
    return replace(scene.frame, rgb=rgb, depth=depth), labels


@pytest.mark.parametrize(("gap", "shift", "count"), [(0.03, 0.0, 1), (0.03, 0.12, 2), (0.09, 0.0, 2)])
def test_sides_of_a_narrow_band_without_depth_are_one_unless_a_step_is_between(
    gap: float, shift: float, count: int
) -> None:
    assert _joined(*_bar_with_a_band(gap, shift)).max() == count


def test_sides_of_a_band_with_other_colours_are_two() -> None:
    frame, labels = _bar_with_a_band(0.03)
    rgb = frame.rgb.copy()
    rgb[labels == 2] = (40, 60, 200)
    assert _joined(replace(frame, rgb=rgb), labels).max() == 2
