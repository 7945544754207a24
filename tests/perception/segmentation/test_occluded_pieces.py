"""Pieces of one thing behind another are joined; neighbours are not."""

from dataclasses import replace

import numpy as np
import pytest

from grs_agents.perception import RGBDFrame, find_table, robot_frame_point_map
from grs_agents.perception.segmentation import join_occluded_pieces
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
