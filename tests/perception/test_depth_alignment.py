"""Depth that is shifted against the colours of its photo is moved back."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from grs_agents.perception.depth_quality import align_depth_with_colors, measure_depth_shift
from grs_agents.perception.reading.scene_source import read_scene
from grs_agents.perception.types import RGBDFrame
from tests.perception import room


def _shift_depth(frame: RGBDFrame, columns: int, rows: int) -> RGBDFrame:
    """The frame, its depth moved to the right and down; nothing is measured where it leaves off."""
    depth = np.roll(frame.depth, (rows, columns), axis=(0, 1))
    depth[: max(rows, 0)], depth[:, : max(columns, 0)] = 0, 0
    depth[len(depth) + min(rows, 0) :], depth[:, depth.shape[1] + min(columns, 0) :] = 0, 0
    return replace(frame, depth=depth)


@pytest.mark.parametrize(("columns", "rows"), [(9, 0), (0, -7), (-12, 10), (20, 5)])
def test_a_shift_is_measured_and_undone(columns: int, rows: int) -> None:
    frame, _, _ = room.photo(room.camera(width=640, height=480), 0.001)
    assert align_depth_with_colors(frame) is frame
    shifted = _shift_depth(frame, columns, rows)
    shift = measure_depth_shift(shifted)
    assert shift and shift.is_significant
    # Near sides of jumps lie a little inside an object's outline, above all at its top.
    assert np.hypot(shift.columns + columns, shift.rows + rows) <= 3.5
    aligned = align_depth_with_colors(shifted)
    (note,) = aligned.notes
    assert f"to the {'right' if columns > 3 else 'left'}" in note or abs(columns) < 3
    assert measure_depth_shift(aligned) is None
    assert np.count_nonzero(aligned.depth) > 0.9 * np.count_nonzero(shifted.depth)


def test_real_cameras_are_calibrated_well_enough(real_scenes: Path) -> None:
    for path in sorted(real_scenes.glob("*_[0-9]")) + sorted(real_scenes.glob("osd_*[05]")):
        frame = read_scene(path)
        assert align_depth_with_colors(frame) is frame, path.name
        shift = measure_depth_shift(_shift_depth(frame, 8, -6))
        assert shift and shift.is_significant and np.hypot(shift.columns + 8, shift.rows - 6) <= 3, path.name
