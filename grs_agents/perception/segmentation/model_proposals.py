"""Segmentation from a model's mask proposals: filtered to the table, overlaps resolved, parts merged by depth."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from grs_agents.perception.configuration import DEFAULT
from grs_agents.perception.image_geometry import Labels, label_connected_components
from grs_agents.perception.segmentation.configuration import MaskProposals, Segmentation
from grs_agents.perception.segmentation.part_merging import merge_parts
from grs_agents.perception.segmentation.patch_cutting import (
    compute_concavity_map,
    cut_smooth_patches,
    find_depth_jumps,
    foreground_pixel_mask,
    grow_labels,
    join_smooth_neighbors,
    measure_label_borders,
    smooth_frame_depth,
)
from grs_agents.perception.segmentation.segmentation import filter_object_segments
from grs_agents.perception.table_finding import robot_frame_point_map
from grs_agents.perception.types import Array, Image, Mask, RGBDFrame, TableFrame
from grs_agents.perception.working_resolution import downscale_frame, upscale_labels


@dataclass(frozen=True)
class Proposal:
    """A mask that a model proposes."""

    mask: Mask  # (H, W)
    score: float  # the model's confidence, 0 to 1
    is_box: bool = False  # whether the mask is a bounding box, to be filled by depth


Proposer = Callable[[Image, Mask], Iterable[Proposal]]
"""Maps a photo and the (h, w) pixels that may show objects, of the same view but perhaps smaller, to (h, w) masks."""


def segment_from_proposals(
    frame: RGBDFrame, table: TableFrame, proposer: Proposer, config: Segmentation = DEFAULT.segmentation
) -> Labels:
    """(H, W) labels: 0 for table and background, 1..N for the proposed objects on the table."""
    small, factor = downscale_frame(frame)
    rows, columns = small.depth.shape
    smooth = smooth_frame_depth(small)
    points = robot_frame_point_map(smooth, table)
    above = foreground_pixel_mask(points, smooth, np.asarray(table.T_robot_cam)[:3, 3], config.foreground)
    patches = cut_smooth_patches(smooth, above, compute_concavity_map(smooth, above, config.patches), config.patches)
    proposals = proposer(frame.rgb[: rows * factor, : columns * factor], above | (smooth.depth <= 0))
    filled = (
        box_to_mask_of_patches(proposal, patches, config.proposals) if proposal.is_box else proposal
        for proposal in proposals
    )
    kept = suppress_duplicate_masks(filter_proposals_on_table(filled, above, points, config), config.proposals.alike)
    labels = paint_proposal_labels(kept, smooth, int(config.filter.smallest * smooth.depth.size))
    labels = _join_smooth_parts(labels, kept, smooth, config)
    # Smooth patches that the proposals leave uncovered are objects too, unknown to the model.
    free = labels == 0
    whole, left = (np.bincount(patches[where], minlength=int(patches.max()) + 1) for where in (patches > 0, free))
    missed = left >= config.proposals.covered * np.maximum(whole, 1)
    missed[0] = False
    labels = np.where(free & missed[patches], patches + labels.max(), labels).astype(np.int32)
    labels = merge_parts(labels, points, small.rgb, config)
    labels = filter_object_segments(labels, smooth, points, table, config)
    return labels if factor == 1 else upscale_labels(labels, small, frame, factor)


def box_to_mask_of_patches(box: Proposal, patches: Labels, config: MaskProposals) -> Proposal:
    """Mask of the smooth patches, (H, W) labels, inside a box; patches of neighbours are cut by its border."""
    whole, held = (np.bincount(patches[where], minlength=int(patches.max()) + 1) for where in (patches >= 0, box.mask))
    inside = held >= config.covered * whole
    inside[0] = False
    return Proposal(inside[patches], box.score)


def filter_proposals_on_table(
    proposals: Iterable[Proposal], above: Mask, points: Array, config: Segmentation
) -> list[Proposal]:
    """The proposals that mostly stand on the table (``above``), without islands, holes, and the table around them.

    Proposals longer than an object are groups, or the whole picture, and are left out. ``points`` are (H, W, 3) in the
    robot frame, NaN where unknown."""
    bounds = config.proposals
    unknown = np.isnan(points[..., 2])
    smallest = int(config.filter.smallest * above.size)
    near = cv2.dilate((above | unknown).astype(np.uint8), np.ones((2 * bounds.spill + 1,) * 2, np.uint8)) > 0
    kept: list[Proposal] = []
    for proposal in proposals:
        standing = int((proposal.mask & above).sum())
        measured = int((proposal.mask & ~unknown).sum())
        if standing < max(smallest, bounds.standing * measured, bounds.seen * int(proposal.mask.sum())):
            continue
        extent = np.ptp(np.percentile(points[proposal.mask & above][:, :2], (2, 98), axis=0), axis=0).max()
        if extent > DEFAULT.measuring.largest:
            continue
        mask: Mask = label_connected_components((proposal.mask & near).astype(np.uint8), smallest) > 0
        mask = label_connected_components((~mask).astype(np.uint8), smallest) == 0
        if int((mask & above).sum()) >= smallest:
            kept.append(Proposal(mask, proposal.score))
    return kept


def suppress_duplicate_masks(proposals: Sequence[Proposal], alike: float) -> list[Proposal]:
    """Non-maximum suppression by intersection over union ``alike``, the best score first; the earlier of equals."""
    order = sorted(range(len(proposals)), key=lambda number: (-proposals[number].score, number))
    packed = [np.packbits(proposals[number].mask) for number in order]
    areas = [int(np.bitwise_count(bits).sum()) for bits in packed]
    kept: list[int] = []
    for rank, bits in enumerate(packed):
        for better in kept:
            if min(areas[rank], areas[better]) <= alike * max(areas[rank], areas[better]):
                continue  # the intersection is at most the smaller, the union at least the larger
            shared = int(np.bitwise_count(bits & packed[better]).sum())
            if shared > alike * (areas[rank] + areas[better] - shared):
                break
        else:
            kept.append(rank)
    return [proposals[order[rank]] for rank in kept]


def paint_proposal_labels(proposals: Sequence[Proposal], frame: RGBDFrame, smallest: int) -> Labels:
    """(H, W) labels of the proposals, the smaller on top; remaining slivers go to the segment they touch."""
    labels = np.zeros(frame.depth.shape, np.int32)
    for number in sorted(range(len(proposals)), key=lambda number: -int(proposals[number].mask.sum())):
        labels[proposals[number].mask] = number + 1
    whole = np.zeros_like(labels)
    for number in range(1, len(proposals) + 1):
        left = cv2.morphologyEx((labels == number).astype(np.uint8), cv2.MORPH_OPEN, np.ones((3, 3), np.uint8))
        whole[label_connected_components(left, smallest) > 0] = number
    return grow_labels(whole, labels > 0, frame.depth)


def _join_smooth_parts(labels: Labels, proposals: Sequence[Proposal], frame: RGBDFrame, config: Segmentation) -> Labels:
    """Join the parts that a proposal covers if the depth between them neither jumps nor creases.

    A print on a box, or its faces, are parts of it: so say the depth, and a mask of the whole with no lower score than
    theirs. Without such a mask two boxes side by side stay two."""
    measured = np.where(frame.depth > 0, labels, 0)
    around = np.ones((2 * config.proposals.blur + 1,) * 2, np.uint8)
    below, right = find_depth_jumps(frame.depth)
    jump = cv2.dilate((below | right).astype(np.uint8), around) > 0
    bend = np.minimum(compute_concavity_map(frame, measured > 0, config.patches), config.patches.jump)
    strength: Array = np.asarray(cv2.dilate(bend, around), np.float64)
    count = int(labels.max()) + 1
    borders = measure_label_borders(measured, strength, jump, jump, config.patches.jump)
    length, total = (np.pad(border, (0, count - len(border))) for border in borders)
    areas = np.maximum(np.bincount(labels.ravel(), minlength=count), 1)
    scores = np.array([1.0, *(proposal.score for proposal in proposals)])[:count]
    together = np.zeros((count, count), np.bool_)
    for proposal in proposals:
        held = np.bincount(labels[proposal.mask], minlength=count) >= config.proposals.covered * areas
        held[0] = False
        together |= held[:, None] & held & (proposal.score >= np.minimum(scores[:, None], scores))
    return join_smooth_neighbors(labels, length, total, together, config.patches)
