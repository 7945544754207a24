"""The object in a rectangle: in clutter, without the pixels of its neighbours, and as a part of a larger mask."""

import numpy as np
import pytest

from grs_agents.perception.segmentation.rectangle_masks import Window, segment_rectangle
from grs_agents.perception.table_finding import find_table
from grs_agents.perception.types import Mask, RGBDFrame, TableFrame
from tests.perception.conftest import Rendered, Thing, render

THINGS = (
    Thing("box", (0.55, 0.0), (0.18, 0.24, 0.05)),
    Thing("box", (0.53, 0.02), (0.08, 0.1, 0.08), yaw=0.3, bottom=0.05),  # on the first
    Thing("box", (0.44, 0.06), (0.03, 0.16, 0.12), yaw=-0.5),  # before it
    Thing("box", (0.45, -0.2), (0.1, 0.1, 0.1), yaw=0.2),
    Thing("cylinder", (0.45, -0.29), (0.08, 0.08, 0.06)),  # touches the former
    Thing("box", (0.42, 0.3), (0.14, 0.18, 0.002)),  # as flat as the noise
    Thing("box", (0.43, 0.3), (0.06, 0.05, 0.05), yaw=0.4, bottom=0.002),  # on it
)
LOWER, UPPER, FRONT, BOX, CAN, SHEET, CUBE = range(1, len(THINGS) + 1)


@pytest.fixture(scope="module")
def clutter() -> Rendered:
    """Stacked, occluded, touching and flat objects."""
    return render(THINGS, calibrated=True)


@pytest.fixture(scope="module")
def table(clutter: Rendered) -> TableFrame:
    """Their table."""
    return find_table(clutter.frame, np.random.default_rng(0))


def window_around(mask: Mask, margin: int = 4) -> Window:
    """A rectangle as a person draws it around an object."""
    rows, columns = np.nonzero(mask)
    return (
        slice(int(rows.min()) - margin, int(rows.max()) + margin),
        slice(int(columns.min()) - margin, int(columns.max()) + margin),
    )


def overlap(mask: Mask | None, truth: Mask) -> float:
    """Intersection over union."""
    return 0.0 if mask is None else float((mask & truth).sum() / (mask | truth).sum())


@pytest.mark.parametrize("number", [LOWER, UPPER, FRONT, BOX, CAN, CUBE])
def test_a_rectangle_in_clutter_gives_the_object_alone(clutter: Rendered, table: TableFrame, number: int) -> None:
    truth = clutter.labels == number
    mask = segment_rectangle(clutter.frame, table, window_around(truth))
    assert overlap(mask, truth) > 0.9
    again = segment_rectangle(clutter.frame, table, window_around(truth))
    assert mask is not None and again is not None and (mask == again).all()


def test_known_objects_that_the_rectangle_is_filled_without_are_left_out(clutter: Rendered, table: TableFrame) -> None:
    truth, cube = clutter.labels == SHEET, clutter.labels == CUBE
    assert overlap(segment_rectangle(clutter.frame, table, window_around(truth)), truth | cube) > 0.9
    assert overlap(segment_rectangle(clutter.frame, table, window_around(truth), [cube]), truth) > 0.9
    # an object that is cut badly is drawn anew, its known pixels included
    truth = clutter.labels == FRONT
    piece = truth & (np.indices(truth.shape)[1] > np.nonzero(truth)[1].mean())
    assert overlap(segment_rectangle(clutter.frame, table, window_around(truth), [piece]), truth) > 0.9


@pytest.mark.parametrize(("number", "rest"), [(UPPER, LOWER), (CAN, BOX), (BOX, CAN)])
def test_a_part_is_cut_from_the_rest_along_its_border(
    clutter: Rendered, table: TableFrame, number: int, rest: int
) -> None:
    part, left = clutter.labels == number, clutter.labels == rest
    mask = segment_rectangle(clutter.frame, table, window_around(part), (), part | left)
    assert mask is not None and overlap(mask, part) > 0.95
    assert overlap((part | left) & ~mask, left) > 0.95


def test_a_part_keeps_within_the_object_in_a_large_photo(clutter: Rendered, table: TableFrame) -> None:
    frame, factor = clutter.frame, 3
    fields = {name: getattr(frame.camera, name) * factor for name in ("fx", "fy", "width", "height")}
    fields |= {name: (getattr(frame.camera, name) + 0.5) * factor - 0.5 for name in ("cx", "cy")}
    rgb, depth = frame.rgb.repeat(factor, 0).repeat(factor, 1), frame.depth.repeat(factor, 0).repeat(factor, 1)
    large = RGBDFrame(rgb, depth, frame.camera.model_copy(update=fields), frame.source)
    whole = np.isin(clutter.labels, (BOX, CAN)).repeat(factor, 0).repeat(factor, 1)
    whole &= np.indices(whole.shape)[0] % 7 > 0  # as a person's edits leave it
    window = window_around((clutter.labels == CAN).repeat(factor, 0).repeat(factor, 1))
    mask = segment_rectangle(large, table, window, (), whole)
    assert mask is not None and not (mask & ~whole).any()


def test_a_bare_table_has_no_object(clutter: Rendered, table: TableFrame) -> None:
    assert segment_rectangle(clutter.frame, table, np.s_[280:320, 60:140]) is None
