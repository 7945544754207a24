"""Masks that a model proposes, stood in for by masks made from the truth: parts, groups, the table, noise."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from grs_agents.perception.configuration import DEFAULT
from grs_agents.perception.segmentation.model_proposals import (
    Proposal,
    segment_from_proposals,
    suppress_duplicate_masks,
)
from grs_agents.perception.table_finding import find_table
from grs_agents.perception.types import Image, Mask, RGBDFrame
from tests.perception.conftest import Rendered

ALIKE = DEFAULT.segmentation.proposals.alike


def _segment(frame: RGBDFrame, *proposals: Proposal) -> np.ndarray:
    return segment_from_proposals(frame, find_table(frame, np.random.default_rng(0)), lambda rgb, where: proposals)


def _wholes(rendered: Rendered, score: float = 0.9) -> list[Proposal]:
    return [Proposal(rendered.labels == label, score) for label in range(1, len(rendered.things) + 1)]


def _halves(rendered: Rendered, label: int, score: float) -> list[Proposal]:
    mask = rendered.labels == label
    left = np.arange(mask.shape[1]) < np.nonzero(mask)[1].mean()
    return [Proposal(mask & left, score), Proposal(mask & ~left, score)]


def _agree(found: np.ndarray, rendered: Rendered) -> bool:
    """Every thing has a segment, and no segment is left over."""
    wholes = [rendered.labels == label for label in range(1, len(rendered.things) + 1)]
    masks = [found == label for label in range(1, int(found.max()) + 1)]
    best = [max(float((whole & mask).sum() / (whole | mask).sum()) for mask in masks) for whole in wholes]
    return len(masks) == len(wholes) and min(best) > 0.85


def test_masks_of_things_are_kept_and_masks_of_the_table_are_not(rendered: Rendered) -> None:
    table = Proposal(rendered.labels == 0, 1.0)
    everything = Proposal(np.ones_like(rendered.labels, np.bool_), 1.0)
    patch = np.zeros_like(table.mask)
    patch[300:340, 200:260] = rendered.labels[300:340, 200:260] == 0
    assert _agree(_segment(rendered.frame, table, everything, Proposal(patch, 1.0), *_wholes(rendered)), rendered)


def test_a_mask_that_spills_over_the_table_is_cut_back(rendered: Rendered) -> None:
    spilled = [
        replace(one, mask=one.mask | np.roll(one.mask, 12, axis=1) & (rendered.labels == 0))
        for one in _wholes(rendered)
    ]
    assert _agree(_segment(rendered.frame, *spilled), rendered)


def test_parts_are_one_where_a_mask_covers_them_and_the_depth_is_smooth(rendered: Rendered) -> None:
    parts = _halves(rendered, 1, 0.85)
    assert _agree(_segment(rendered.frame, *parts, *_wholes(rendered)), rendered)
    alone = _segment(rendered.frame, *parts, *_wholes(rendered)[1:])
    assert alone.max() == len(rendered.things) + 1  # no mask says that the halves belong together


def test_a_group_that_scores_worse_than_its_things_does_not_join_them(stacked: Rendered) -> None:
    group = Proposal(np.isin(stacked.labels, (1, 2)), 0.85)
    assert _agree(_segment(stacked.frame, group, *_wholes(stacked)), stacked)


def test_a_group_does_not_join_across_a_crease_or_a_jump(stacked: Rendered) -> None:
    groups = [Proposal(np.isin(stacked.labels, pair), 0.99) for pair in ((1, 2), (3, 4))]
    assert _agree(_segment(stacked.frame, *groups, *_wholes(stacked)), stacked)


def test_islands_and_holes_are_mended(rendered: Rendered) -> None:
    masks = _wholes(rendered)
    torn = masks[0].mask.copy()
    rows, columns = np.nonzero(torn)
    torn[int(rows.mean()) : int(rows.mean()) + 4, int(columns.mean()) : int(columns.mean()) + 4] = False
    rows, columns = np.nonzero(masks[1].mask)
    torn[int(rows.mean()), int(columns.mean())] = True
    mended = _segment(rendered.frame, Proposal(torn, 0.95), *masks[1:])
    assert _agree(mended, rendered)
    assert len(np.unique(mended[masks[0].mask])) <= 2


def test_unmeasured_pixels_of_a_thing_are_kept(rendered: Rendered) -> None:
    """A shiny thing: half of it has no depth, which is what masks are good for."""
    depth = rendered.frame.depth.copy()
    dark = _halves(rendered, 1, 0.9)[0].mask
    depth[dark] = 0
    found = _segment(replace(rendered.frame, depth=depth), *_wholes(rendered))
    assert _agree(found, rendered)


def test_without_depth_on_anything_nothing_is_found(rendered: Rendered) -> None:
    depth = np.where(rendered.labels > 0, np.float32(0), rendered.frame.depth).astype(np.float32)
    assert _segment(replace(rendered.frame, depth=depth), *_wholes(rendered)).max() == 0


def test_what_no_proposal_covers_is_segmented_by_its_depth(rendered: Rendered) -> None:
    assert _agree(_segment(rendered.frame), rendered)
    assert _agree(_segment(rendered.frame, *_wholes(rendered)[1:]), rendered)


def test_boxes_are_filled_by_depth(stacked: Rendered) -> None:
    """What a box holds of its neighbours is not its object's."""
    boxes: list[Proposal] = []
    for one in _wholes(stacked, 0.3):
        rows, columns = np.nonzero(one.mask)
        box = np.zeros_like(one.mask)
        box[rows.min() : rows.max() + 1, columns.min() : columns.max() + 1] = True
        boxes.append(replace(one, mask=box, is_box=True))
    assert _agree(_segment(stacked.frame, *boxes), stacked)


@pytest.mark.parametrize("order", [1, -1])
def test_the_order_of_different_proposals_does_not_matter(rendered: Rendered, order: int) -> None:
    asked = [*_wholes(rendered, 0.9), *_halves(rendered, 1, 0.8), *_halves(rendered, 3, 0.81)]
    first, second = _segment(rendered.frame, *asked), _segment(rendered.frame, *asked[::order])
    assert ((first > 0) == (second > 0)).all()
    assert first.max() == second.max()


def test_a_large_photo_is_asked_about_at_its_full_size(rendered: Rendered) -> None:
    camera, frame = rendered.frame.camera, rendered.frame
    twice = {key: getattr(camera, key) * 3 for key in ("fx", "fy", "width", "height")}
    twice |= {key: (getattr(camera, key) + 0.5) * 3 - 0.5 for key in ("cx", "cy")}
    rows, columns = np.indices(frame.depth.shape).repeat(3, axis=1).repeat(3, axis=2)
    rgb, depth = frame.rgb[rows, columns], frame.depth[rows, columns]
    large = RGBDFrame(rgb, depth, camera.model_copy(update=twice), frame.source)
    seen: list[tuple[Image, Mask]] = []

    def proposer(rgb: Image, where: Mask) -> list[Proposal]:
        seen.append((rgb, where))
        rows, columns = (
            np.arange(size) * whole // size for size, whole in zip(where.shape, rendered.labels.shape, strict=True)
        )
        return [replace(one, mask=one.mask[np.ix_(rows, columns)]) for one in _wholes(rendered)]

    labels = segment_from_proposals(large, find_table(large, np.random.default_rng(0)), proposer)
    assert labels.shape == depth.shape
    assert labels.max() == 4
    assert seen[0][0].shape[0] > 2 * seen[0][1].shape[0] - 1
    assert seen[0][1].any()


@given(st.lists(st.tuples(st.integers(0, 30), st.integers(1, 30), st.sampled_from([0.8, 0.9])), max_size=12))
def test_of_masks_that_are_alike_the_best_is_kept(spans: list[tuple[int, int, float]]) -> None:
    def mask(start: int, length: int) -> Mask:
        return np.array([[start <= column < start + length for column in range(64)]])

    def overlap(one: Mask, other: Mask) -> float:
        return float((one & other).sum() / (one | other).sum())

    proposals = [Proposal(mask(start, length), score) for start, length, score in spans]
    kept = suppress_duplicate_masks(proposals, ALIKE)
    for number, one in enumerate(kept):
        assert all(overlap(one.mask, other.mask) <= ALIKE for other in kept[:number])
    for one in proposals:
        assert any(other.score >= one.score and overlap(one.mask, other.mask) > ALIKE for other in kept) or any(
            one is other for other in kept
        )
