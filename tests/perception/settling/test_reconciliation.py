"""Segments agree with the known objects."""

import numpy as np

from grs_agents.library.library import Library
from grs_agents.perception.settling.segment_reconciliation import Reconciled, reconcile_segments
from grs_agents.perception.settling.settling import PlacedObject
from grs_agents.perception.types import Aabb, CandidateRecord, Mask, RGBDFrame, TableFrame, UprightBox
from tests.perception.settling.photo import photo_of

LIBRARY = Library()
MILK = PlacedObject("HOPE/Milk.urdf", ((0.5, 0.0, 0.096), (0.0, 0.0, 0.0, 1.0)))
BLOCK = PlacedObject("block/red_block.urdf", ((0.38, 0.05, 0.02), (0.0, 0.0, 0.0, 1.0)))
MeasuredSegment = tuple[Mask, CandidateRecord, PlacedObject | None]


def segment(mask: Mask, box: UprightBox, known: PlacedObject | None, **fields: bool) -> MeasuredSegment:
    """A segment with its measured box and, if it is known, its asset."""
    record = CandidateRecord(
        id=1,
        mask="mask.png",
        crop="crop.png",
        box=Aabb(low=(0.0, 0.0, 0.0), high=(1.0, 1.0, 1.0)),
        upright=box,
        color=(0.5, 0.5, 0.5),
        shape="box",
        points=int(mask.sum()),
    )
    return mask, record.model_copy(update=fields), known


def reconcile(segments: list[MeasuredSegment], frame: RGBDFrame, table: TableFrame) -> Reconciled:
    masks = [mask for mask, _, _ in segments]
    records, known = [record for _, record, _ in segments], [asset for _, _, asset in segments]
    return reconcile_segments(records, masks, known, frame, table, LIBRARY)


def test_a_piece_is_dropped_and_a_fat_box_gives_way() -> None:
    frame, table, both = photo_of([MILK, BLOCK], LIBRARY)
    _, _, milk = photo_of([MILK], LIBRARY)
    milk &= frame.depth == photo_of([MILK], LIBRARY)[0].depth
    upper = milk & (np.arange(milk.shape[0])[:, None] < np.median(np.nonzero(milk)[0]) - 10)
    box = UprightBox(center=(0.42, 0.05, 0.02), size=(0.12, 0.04, 0.04), yaw=0.0)  # reaches into the milk
    segments = [
        segment(milk & ~upper, box, MILK),
        segment(upper, box, None),
        segment(both & ~milk, box, None),
    ]
    agreed = reconcile(segments, frame, table)
    assert agreed.pieces == {1: 0}
    assert set(agreed.claims) == {2}
    assert agreed.claims[2].box.size[0] < 0.11


def test_what_is_not_on_the_surface_of_a_known_thing_stays_an_object() -> None:
    """However much of its box lies in that thing, or in another's box: boxes are guesses where nothing was seen."""
    frame, table, mask = photo_of([MILK, BLOCK], LIBRARY)
    block = photo_of([BLOCK], LIBRARY)[2] & mask
    around = UprightBox(center=(0.45, 0.02, 0.1), size=(0.25, 0.2, 0.21), yaw=0.0)
    inner = UprightBox(center=MILK.pose[0], size=(0.04, 0.04, 0.15), yaw=0.0)
    for known, box in ((MILK, inner), (None, around)):
        segments = [segment(mask & ~block, around, known), segment(block, box, None)]
        agreed = reconcile(segments, frame, table)
        assert not agreed.pieces and 1 in agreed.claims


def test_what_the_user_says_is_one_object_is_no_piece_of_a_known_one() -> None:
    frame, table, milk = photo_of([MILK], LIBRARY)
    upper = milk & (np.arange(milk.shape[0])[:, None] < np.median(np.nonzero(milk)[0]) - 10)
    box = UprightBox(center=MILK.pose[0], size=(0.07, 0.07, 0.1), yaw=0.0)
    for given, pieces in ((False, {1: 0}), (True, {})):
        known = segment(milk & ~upper, box, MILK, given=given)
        agreed = reconcile([known, segment(upper, box, None, given=given)], frame, table)
        assert agreed.pieces == pieces


def test_what_lies_in_a_known_box_stands_on_its_floor() -> None:
    """The box measured of a block there reaches down to the table."""
    container = PlacedObject("container/open_box.urdf", ((0.5, 0.0, 0.045), (0.0, 0.0, 0.0, 1.0)))
    block = PlacedObject(BLOCK.asset, ((0.5, 0.0, 0.03), (0.0, 0.0, 0.0, 1.0)))
    frame, table, mask = photo_of([container, block], LIBRARY)
    alone = photo_of([container], LIBRARY)[0]
    inner = mask & (np.abs(frame.depth - alone.depth) > 1e-4)
    down = UprightBox(center=(0.5, 0.0, 0.025), size=(0.04, 0.04, 0.05), yaw=0.0)
    around = UprightBox(center=container.pose[0], size=(0.3, 0.22, 0.09), yaw=0.0)
    segments = [
        segment(mask & ~inner, around, container, hollow=True),
        segment(inner, down, None),
    ]
    low = reconcile(segments, frame, table).claims[1].box
    assert 0.003 < low.center[2] - low.size[2] / 2 < 0.015
    assert abs(low.center[2] + low.size[2] / 2 - 0.05) < 1e-6, "its top stays"
    free = reconcile([segments[1]], frame, table).claims[0].box
    assert free == down, "on the table it stays"
