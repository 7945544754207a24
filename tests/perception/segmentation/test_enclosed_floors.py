"""Floors of boxes: lower than the noise, and given to their walls, whatever hides a part of these."""

import numpy as np
import pytest

from grs_agents.perception.coverage import raised_pixel_mask
from grs_agents.perception.segmentation.segmentation import segment_objects_on_table
from grs_agents.perception.table_finding import find_table
from grs_agents.perception.types import RGBDFrame
from tests.perception import room

INSIDE = (0.405, -0.095), (0.595, 0.095)
WALLS = [(0.4, -0.1, 0.6, -0.095), (0.4, 0.095, 0.6, 0.1), (0.4, -0.095, 0.405, 0.095), (0.595, -0.095, 0.6, 0.095)]


def _open_box(floor: float) -> tuple[RGBDFrame, np.ndarray]:
    """A photo of thin walls with something low between, of which the depth of the nearest wall and a corner is missing;
    and which pixels show what is between."""
    sides = [((x, y, 0.0), (far, left, 0.05)) for x, y, far, left in WALLS]
    boxes = np.concatenate([room.BOXES[:4], np.array([*sides, ((*INSIDE[0], 0.0), (*INSIDE[1], floor))])])
    frame, _, owner = room.photo(room.camera(width=640, height=480), noise=0.002, boxes=boxes)
    own = owner == 8
    rows, columns = np.nonzero(own)
    hidden = np.zeros(own.shape, np.bool_)
    hidden[rows.max() - 6 : rows.max() + 30, columns.min() - 40 : columns.max() + 40] = True
    hidden[: rows.min() + 10, columns.max() - 25 : columns.max() + 40] = True
    depth = np.where(hidden, np.float32(0), frame.depth)
    return RGBDFrame(frame.rgb, depth, frame.camera, frame.source), own & ~hidden


@pytest.mark.parametrize(("thickness", "is_floor"), [(0.0055, True), (0.0005, False)])
def test_a_floor_belongs_to_the_walls_around_it_and_the_table_does_not(thickness: float, is_floor: bool) -> None:
    frame, own = _open_box(thickness)
    table = find_table(frame, np.random.default_rng(0))
    labels = segment_objects_on_table(frame, table)
    assert np.count_nonzero(own) > 1000
    assert (raised_pixel_mask(frame, table)[own].mean() > 0.8) == is_floor
    owned = np.bincount(labels[own], minlength=1) / np.count_nonzero(own)
    assert (owned[1:].max(initial=0) > 0.8) == is_floor
