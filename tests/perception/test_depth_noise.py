"""The noise of a depth camera is measured, and smoothed where it is large."""

import numpy as np
import pytest

from grs_agents.perception.depth_quality import measure_depth_noise, smooth_depth_noise
from grs_agents.perception.segmentation.segmentation import segment_objects_on_table
from grs_agents.perception.table_finding import find_table
from tests.perception import room


@pytest.mark.parametrize("noise", [0.001, 0.003, 0.015, 0.03])
def test_the_noise_is_measured(noise: float) -> None:
    frame, _, _ = room.photo(room.camera(), noise)
    assert measure_depth_noise(frame).at_one_metre == pytest.approx(noise, rel=0.1)


def test_a_usual_camera_is_left_as_it_is() -> None:
    frame, _, _ = room.photo(room.camera(), 0.003)
    assert smooth_depth_noise(frame, measure_depth_noise(frame)) is frame


def test_objects_are_found_in_much_noise() -> None:
    frame, _, owner = room.photo(room.camera(width=640, height=480), 0.015)
    smooth = smooth_depth_noise(frame, measure_depth_noise(frame))
    assert "15" in smooth.notes[-1]
    labels = segment_objects_on_table(smooth, find_table(smooth, np.random.default_rng(0)))
    for thing in room.THINGS:
        label = np.bincount(labels[owner == thing]).argmax()
        both, either = (labels == label) & (owner == thing), (labels == label) | (owner == thing)
        assert label > 0 and np.count_nonzero(both) > 0.5 * np.count_nonzero(either)
