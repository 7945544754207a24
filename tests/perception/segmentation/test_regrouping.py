"""Statements on segments are applied where geometry bears them out, and noted where it does not."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import cv2
import numpy as np
import pytest

from grs_agents.perception.image_geometry import mask_bounding_slices
from grs_agents.perception.segmentation import regrouping
from grs_agents.perception.segmentation.candidates import measure_candidates
from grs_agents.perception.segmentation.regrouping import (
    PixelBox,
    RegroupedSegments,
    Regrouping,
    divide_mask_by_boxes,
    regroup_segments,
)
from grs_agents.perception.types import Candidate, Mask, RGBDFrame, TableFrame
from tests.perception.settling.photo import BLOCK, LIBRARY, MILK, photo_of, standing


@dataclass(frozen=True)
class Things:
    """A carton, a block before it that hides a part of it, and a block apart, with the pixels of each."""

    frame: RGBDFrame
    table: TableFrame
    carton: Mask
    near: Mask
    apart: Mask

    @property
    def nothing(self) -> Mask:
        """No pixel."""
        return np.zeros_like(self.carton)

    def candidates(self, *masks: Mask) -> tuple[Candidate, ...]:
        """The segments with ``masks``, numbered from 1."""
        labels = np.zeros(self.frame.depth.shape, np.int32)
        for number, mask in enumerate(masks, 1):
            labels[mask] = number
        return measure_candidates(self.frame, self.table, labels)

    def regroup(self, candidates: Sequence[Candidate], robot: Mask | None = None, **said: Any) -> RegroupedSegments:
        """The segments after the statements."""
        robot = self.nothing if robot is None else robot
        return regroup_segments(self.frame, self.table, candidates, robot, Regrouping(**said))


@pytest.fixture(scope="module")
def things() -> Things:
    carton, near, apart = standing(MILK, 0.55, 0.0), standing(BLOCK, 0.45, 0.0), standing(BLOCK, 0.42, 0.15)
    frame, table, every = photo_of([carton, near, apart], LIBRARY)
    alone = [photo_of([thing], LIBRARY) for thing in (near, apart)]
    masks = [every & mask & (np.abs(shot.depth - frame.depth) < 1e-4) for shot, _, mask in alone]
    return Things(frame, table, every & ~masks[0] & ~masks[1], *masks)


def box_of(mask: Mask, spill: float = 0.0) -> PixelBox:
    """The rectangle of a mask, larger by so many pixels on each side."""
    rows, columns = mask_bounding_slices(mask)
    wide, high = columns.stop - columns.start, rows.stop - rows.start
    return columns.start - spill, rows.start - spill, wide + 2 * spill, high + 2 * spill


def halves(mask: Mask) -> tuple[Mask, Mask]:
    """The upper and the lower half of a mask."""
    rows = np.arange(mask.shape[0])[:, None]
    upper = mask & (rows < np.median(np.nonzero(mask)[0]))
    return upper, mask & ~upper


def agreement(first: Mask, second: Mask) -> float:
    """Intersection over union."""
    return float(np.count_nonzero(first & second) / np.count_nonzero(first | second))


def test_parts_of_an_object_become_one_segment_measured_anew(things: Things) -> None:
    found = things.regroup(things.candidates(*halves(things.carton), things.apart), merged=[(1, 2)])
    assert [item.id for item in found.candidates] == [3, 4]
    assert np.array_equal(found.candidates[1].mask, things.carton)
    assert found.candidates[1].upright.size[2] == pytest.approx(LIBRARY.asset(MILK).size[2], abs=0.01)
    assert {item.id: item.reason for item in found.dropped} == dict.fromkeys(
        (1, 2), "a piece of a larger thing, candidate 4"
    )
    assert not found.notes and not found.scenery.any()


def test_segments_far_from_each_other_are_not_merged(things: Things) -> None:
    before = things.candidates(*halves(things.carton), things.apart)
    found = things.regroup(before, merged=[(1, 3, 2)])
    assert [item.id for item in found.candidates] == [3, 4]  # its parts are
    (note,) = found.notes
    assert note == "segment 3 is not merged with 1, 2: more than 6 visible pixels or 10 cm apart"


def test_what_stands_far_behind_is_not_merged_though_it_adjoins_in_the_photo() -> None:
    front, back = standing(MILK, 0.4, 0.0), standing(MILK, 0.7, 0.0)
    frame, table, every = photo_of([front, back], LIBRARY)
    near = every & (np.abs(photo_of([front], LIBRARY)[0].depth - frame.depth) < 1e-4)
    things = Things(frame, table, near, near, near)
    before = things.candidates(near, every & ~near)
    found = things.regroup(before, merged=[(1, 2)])
    assert found.candidates == before and len(found.notes) == 1


def test_parts_on_both_sides_of_what_hides_the_middle_are_merged(things: Things) -> None:
    rows = np.arange(len(things.carton))[:, None]
    middle = np.median(np.nonzero(things.carton)[0])
    band = things.carton & (np.abs(rows - middle) < 10)
    upper, lower = things.carton & ~band & (rows < middle), things.carton & ~band & (rows > middle)
    hidden = things.regroup(things.candidates(upper, lower, band), merged=[(1, 2)])
    assert [item.id for item in hidden.candidates] == [3, 4] and not hidden.notes
    seen = things.regroup(things.candidates(upper, lower), merged=[(1, 2)])
    assert [item.id for item in seen.candidates] == [1, 2] and len(seen.notes) == 1


def test_what_would_be_larger_than_any_object_is_not_merged(things: Things) -> None:
    """Strips of the table that touch each other."""
    rows, columns = np.indices(things.carton.shape)
    strips = [(rows < 15) & (columns // 60 == index) for index in range(4)]
    before = things.candidates(*strips)
    wide = things.regroup(before, merged=[(1, 2, 3, 4)])
    assert "object of more than 0.5 m" in wide.notes[0]
    assert [item.id for item in wide.candidates] == [1, 2, 3, 4]


@pytest.mark.parametrize("order", [1, -1])
def test_a_segment_with_several_objects_is_divided_by_colour_and_depth(things: Things, order: int) -> None:
    before = things.candidates(things.carton | things.near, things.apart)
    masks = [things.carton, things.near][::order]
    found = things.regroup(before, divided=[(1, [box_of(mask, spill=3) for mask in masks])])
    assert not found.notes
    assert [item.id for item in found.candidates] == [2, 3, 4]
    assert agreement(found.candidates[1].mask, masks[0]) > 0.9
    assert agreement(found.candidates[2].mask, masks[1]) > 0.9
    assert {item.id: item.reason for item in found.dropped} == {1: "several objects: candidates 3, 4"}


@pytest.mark.parametrize("order", [1, -1])
def test_an_object_before_a_larger_one_keeps_its_pixels(things: Things, order: int) -> None:
    x, y, wide, high = (round(side) for side in box_of(things.carton))
    window = np.s_[y + high // 3 : y + 2 * high // 3, x + wide // 3 : x + 2 * wide // 3]
    label, rgb = things.nothing, things.frame.rgb.copy()
    label[window], rgb[window] = True, (20, 160, 60)
    masks = [label & things.carton, things.carton & ~label]
    boxes = [box_of(mask) for mask in masks][::order]
    *parts, rest = divide_mask_by_boxes(replace(things.frame, rgb=rgb), things.carton, boxes)
    assert not rest.any()
    assert [agreement(part, mask) > 0.75 for part, mask in zip(parts, masks[::order], strict=True)] == [True, True]


def test_the_rest_beyond_the_boxes_is_a_part_too(things: Things) -> None:
    united = things.carton | things.apart
    parts = divide_mask_by_boxes(things.frame, united, [box_of(things.apart, spill=2)])
    assert len(parts) == 2
    assert np.array_equal(parts[0] | parts[1], united)
    assert agreement(parts[0], things.apart) > 0.9 and agreement(parts[1], things.carton) > 0.9


@pytest.mark.parametrize(
    ("boxes", "why"),
    [
        ([(-500.0, -500.0, 20.0, 20.0), (9000.0, 9000.0, 10.0, 10.0)], "fewer than two of its parts"),
        ([(0.0, 0.0, 1e6, 1e6)], "fewer than two of its parts"),
        ([], "fewer than two of its parts"),
    ],
)
def test_a_segment_is_not_divided_by_boxes_beside_it(things: Things, boxes: list[PixelBox], why: str) -> None:
    before = things.candidates(things.carton, things.apart)
    found = things.regroup(before, divided=[(1, boxes)])
    assert [item.id for item in found.candidates] == [1, 2]
    assert why in found.notes[0] and len(found.notes) == 1 and not found.dropped


def test_a_part_with_too_few_measured_pixels_leaves_the_segment_whole(things: Things) -> None:
    x, y, wide, high = box_of(things.carton)
    blind = things.carton & halves(things.carton)[0]
    frame = replace(things.frame, depth=np.where(blind, np.float32(0), things.frame.depth))
    before = things.candidates(things.carton, things.apart)
    said = Regrouping(divided=[(1, [(x, y, wide, high / 3), (x, y + high / 2, wide, high / 2)])])
    found = regroup_segments(frame, things.table, before, things.nothing, said)
    assert [item.id for item in found.candidates] == [1, 2]
    assert "measured pixels, not 17 each" in found.notes[0]


def test_a_part_of_a_divided_segment_is_merged_by_its_name(things: Things) -> None:
    upper, lower = halves(things.carton)
    before = things.candidates(upper | things.near, lower, things.apart)
    boxes = [box_of(things.near, spill=2), box_of(upper, spill=2)]
    found = things.regroup(before, divided=[(1, boxes)], merged=[(2, "1b")])
    assert [item.id for item in found.candidates] == [3, 4, 6]
    assert agreement(found.candidates[1].mask, things.near) > 0.9
    assert agreement(found.candidates[2].mask, things.carton) > 0.9
    assert {item.id: item.reason for item in found.dropped} == {
        1: "several objects: candidates 4, 5",
        **dict.fromkeys((2, 5), "a piece of a larger thing, candidate 6"),
    }
    assert not found.notes


def test_table_around_an_object_is_dropped_as_the_last_part(things: Things) -> None:
    x, y, wide, high = (round(side) for side in box_of(things.apart))
    table = things.nothing
    table[y : y + high, x + 2 * wide : x + 4 * wide] = True
    table &= ~things.carton & ~things.near
    before = things.candidates(things.apart | table, things.carton)
    found = things.regroup(before, divided=[(1, [box_of(things.apart)])], scenery=[("1b", "table"), ("1c", "table")])
    assert [item.id for item in found.candidates] == [2, 3]
    assert agreement(found.candidates[1].mask, things.apart) > 0.9
    assert {item.id: item.reason for item in found.dropped} == {
        1: "several objects: candidates 3, 4",
        4: "scenery: table",
    }
    assert agreement(found.scenery, table) > 0.9
    assert found.notes == ("table: there is no segment 1c",)


def test_parts_keep_the_names_of_their_boxes(things: Things) -> None:
    """The first box lies beside the segment: its part has no pixels."""
    before = things.candidates(things.carton | things.near, things.apart)
    boxes = [(0.0, 0.0, 3.0, 3.0), *(box_of(mask, spill=2) for mask in (things.carton, things.near))]
    found = things.regroup(before, divided=[(1, boxes)], scenery=[("1a", "hand"), ("1c", "robot")])
    assert found.notes == ("hand: there is no segment 1a",)
    assert agreement(found.scenery, things.near) > 0.9


@pytest.mark.parametrize("side", [256, 30])
def test_the_rest_of_an_object_is_added_by_its_colours(
    things: Things, side: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Its depth is that of the table, as of the low sides of a thing; large things are cut out in a smaller picture."""
    monkeypatch.setattr(regrouping, "CONFIG", replace(regrouping.CONFIG, cut=side))
    inner = cv2.erode(things.apart.astype(np.uint8), np.ones((9, 9), np.uint8)) > 0
    flat = things.apart & ~inner
    frame = replace(things.frame, depth=np.where(flat, things.frame.depth.max(), things.frame.depth))
    before = things.candidates(inner, things.carton)
    said = Regrouping(missing=[("block", box_of(things.apart, spill=2), 1)])
    found = regroup_segments(frame, things.table, before, things.nothing, said)
    assert [item.id for item in found.candidates] == [2, 3] and not found.notes
    assert agreement(found.candidates[1].mask, things.apart) > 0.8
    assert not (things.apart & ~found.candidates[1].mask).any()  # nor a seam around the segment
    assert {item.id: item.reason for item in found.dropped} == {1: "a piece of a larger thing, candidate 3"}


def test_the_rest_is_added_to_what_its_segment_was_merged_into(things: Things) -> None:
    upper, lower = halves(things.carton)
    top, middle = halves(upper)
    before = things.candidates(lower, middle, things.apart)
    found = things.regroup(before, merged=[(1, 2)], missing=[("top", box_of(things.carton, spill=2), 2)])
    assert [item.id for item in found.candidates] == [3, 5] and not found.notes
    assert np.count_nonzero(found.candidates[1].mask & top) > 0.9 * np.count_nonzero(top)


@pytest.mark.parametrize(
    ("whole", "beside", "why"),
    [
        (9, False, "there is no segment 9"),
        ("1a", False, "there is no segment 1a"),
        (2, False, "segment 2 is gone: scenery: hand"),
        (1, True, "segment 1 is not in its box"),
        (1, False, "0 pixels beside segment 1 have its colours"),
    ],
)
def test_a_rest_that_is_not_seen_is_not_added(things: Things, whole: int | str, beside: bool, why: str) -> None:
    before = things.candidates(things.apart, things.near)
    box = (2.0, 150.0, 25.0, 25.0) if beside else box_of(things.apart)
    found = things.regroup(before, scenery=[(2, "hand")], missing=[("rest", box, whole)])
    assert [item.id for item in found.candidates] == [1]
    assert len(found.notes) == 1 and found.notes[0].startswith("rest is not added: ") and why in found.notes[0]


@pytest.mark.parametrize("measured", [True, False])
def test_a_missing_object_is_told_from_raised_table_by_its_colours(things: Things, measured: bool) -> None:
    """A thin object across its box, beside noise of the table that is taken for something raised."""
    x, y, wide, high = (round(side) for side in box_of(things.apart))
    rows, columns = np.indices(things.apart.shape)
    within = (np.abs(rows - y - high / 2) <= high) & (np.abs(columns - x - wide / 2) <= wide)
    table = (things.frame.depth >= things.frame.depth[within & ~things.apart].min()) & ~things.apart
    noise = within & table & (rows > y + high) & ~things.near & ~things.carton
    depth = things.frame.depth - np.float32(0.012) * noise
    if not measured:
        depth = np.where(things.apart, 0, depth).astype(np.float32)
    box = (x - wide / 2, y - high / 2, 2.0 * wide, 2.0 * high)
    before = things.candidates(things.carton, things.near)
    said = Regrouping(missing=[("block", box, None)])
    found = regroup_segments(replace(things.frame, depth=depth), things.table, before, things.nothing, said)
    if measured:
        assert agreement(found.candidates[2].mask, things.apart) > 0.8
    else:
        assert found.candidates == before
        assert found.notes == ("block is not added: it is on the table, or was not measured",)


def test_table_beside_a_missing_object_is_cut_off_by_its_colours(things: Things) -> None:
    x, y, wide, high = (round(side) for side in box_of(things.apart))
    depth = things.frame.depth.copy()
    depth[y : y + high, x + 3 * wide // 4 : x + wide + 4] -= np.float32(0.012)
    before = things.candidates(things.carton, things.near)
    said = Regrouping(missing=[("block", box_of(things.apart, spill=3), None)])
    found = regroup_segments(replace(things.frame, depth=depth), things.table, before, things.nothing, said)
    assert agreement(found.candidates[2].mask, things.apart) > 0.85


def test_scenery_is_dropped_with_its_name(things: Things) -> None:
    before = things.candidates(things.carton, things.near, things.apart)
    found = things.regroup(before, scenery=[(1, "robot arm"), (1, "wall"), (7, "hand"), (2, "")])
    assert [item.id for item in found.candidates] == [3]
    assert [(item.id, item.reason) for item in found.dropped] == [(1, "scenery: robot arm"), (2, "scenery: no object")]
    assert np.array_equal(found.scenery, things.carton | things.near)
    assert found.notes == ("wall: segment 1 is gone: scenery: robot arm", "hand: there is no segment 7")


def test_a_photo_without_any_object_stays_segmented_as_it_is(things: Things) -> None:
    before = things.candidates(things.carton, things.apart)
    walls = [(1, "wall"), (2, "wall")]
    found = things.regroup(before, scenery=walls)
    assert found.candidates == before and not found.dropped and not found.scenery.any()
    assert found.notes == ("none of the 2 segments would be an object: the segmentation stays as it is",)
    added = things.regroup(before, scenery=walls, missing=[("block", box_of(things.apart), None)])
    assert [item.id for item in added.candidates] == [3] and len(added.dropped) == 2


def test_given_masks_are_neither_dropped_nor_merged_nor_divided(things: Things) -> None:
    before = tuple(replace(item, given=True) for item in things.candidates(*halves(things.carton), things.apart))
    boxes = [box_of(things.carton), box_of(things.near)]
    found = things.regroup(before, merged=[(1, 2)], divided=[(1, boxes)], scenery=[(3, "hand")])
    assert found.candidates == before
    assert len(found.notes) == 4 and all("was given" in note for note in found.notes)


def test_a_missing_object_is_found_in_its_box(things: Things) -> None:
    found = things.regroup(
        things.candidates(things.carton), missing=[("red block", box_of(things.apart, spill=8), None)]
    )
    assert not found.notes
    assert [item.id for item in found.candidates] == [1, 2]
    assert agreement(found.candidates[1].mask, things.apart) > 0.9
    assert found.candidates[1].upright.size == pytest.approx((0.04, 0.04, 0.04), abs=0.01)


def test_a_missing_object_may_lie_in_what_was_taken_for_scenery(things: Things) -> None:
    before = things.candidates(things.carton, things.near | things.apart)
    found = things.regroup(before, scenery=[(2, "hand")], missing=[("block", box_of(things.apart), None)])
    assert [item.id for item in found.candidates] == [1, 3]
    assert not (found.scenery & found.candidates[1].mask).any()
    assert (found.scenery & things.near).any()


@pytest.mark.parametrize("place", ["owned", "table", "robot", "outside", "thin"])
def test_an_object_that_was_not_measured_is_not_added(things: Things, place: str) -> None:
    boxes: dict[str, PixelBox] = {
        "owned": box_of(things.carton),
        "table": (2.0, 150.0, 25.0, 25.0),
        "robot": box_of(things.apart),
        "outside": (-80.0, 900.0, 60.0, 60.0),
        "thin": (*box_of(things.apart)[:2], 1e-3, 1e-3),
    }
    before = things.candidates(things.carton)
    found = things.regroup(before, robot=things.apart, missing=[("a cup", boxes[place], None)])
    assert found.candidates == before
    (note,) = found.notes
    assert note.startswith("a cup is not added: ")
    assert place != "owned" or "belongs to segments" in note


def test_statements_that_contradict_each_other_are_noted(things: Things) -> None:
    before = things.candidates(*halves(things.carton), things.apart)
    found = things.regroup(before, merged=[(1, 2), (2, 3), (1, 1), (9,), ()])
    assert [item.id for item in found.candidates] == [3, 4]
    assert [note for note in found.notes if "is gone" in note] and "there is no segment 9" in found.notes[-1]
