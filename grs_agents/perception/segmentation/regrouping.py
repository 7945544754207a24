"""Regrouping of segments by the word of a model that saw them numbered in the photo, checked by geometry."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from string import ascii_lowercase

import cv2
import numpy as np
import numpy.typing as npt

from grs_agents.perception.configuration import DEFAULT
from grs_agents.perception.image_geometry import (
    grow_window,
    label_connected_components,
    mask_bounding_slices,
    pixels_by_label,
)
from grs_agents.perception.segmentation.candidates import measure_beside_others
from grs_agents.perception.segmentation.described_pieces import gap_between_boxes
from grs_agents.perception.table_finding import robot_frame_point_map
from grs_agents.perception.types import Candidate, DroppedCandidate, Image, Mask, RGBDFrame, TableFrame

CONFIG, SMALLEST = DEFAULT.regrouping, DEFAULT.segmentation.filter.smallest
PixelBox = tuple[float, float, float, float]
"""Left, top, width and height of a rectangle in the photo, pixels; it may reach beyond the photo."""
SegmentName = int | str
"""The number of a segment, or the name of a part of a divided one: ``3a`` for the part of 3 in its first box."""


def scale_box(box: PixelBox, scale: float) -> PixelBox:
    """A box of a picture, in pixels of a picture ``scale`` times as large."""
    x, y, wide, high = (scale * side for side in box)
    return x, y, wide, high


@dataclass(frozen=True)
class Regrouping:
    """Statements on the segments of a photo, by name. They may be wrong."""

    merged: Sequence[Sequence[SegmentName]] = ()  # groups of segments that show one object each
    divided: Sequence[tuple[int, Sequence[PixelBox]]] = ()  # segments with several objects, and a box of each
    scenery: Sequence[tuple[SegmentName, str]] = ()  # segments that are no object, and a name for what they show
    # objects without a segment: name and box; or the rest of an object that a segment shows in part, and that segment
    missing: Sequence[tuple[str, PixelBox, SegmentName | None]] = ()


@dataclass(frozen=True)
class RegroupedSegments:
    """The segments after a regrouping, as far as it was applied."""

    candidates: tuple[Candidate, ...]  # unchanged segments with their numbers, then the new segments
    dropped: tuple[DroppedCandidate, ...]  # scenery, and the segments that were merged or divided
    scenery: Mask  # (H, W) pixels of the dropped scenery
    notes: tuple[str, ...]  # a line for each statement that was not applied


class _Segments:
    """The segments while they are regrouped."""

    def __init__(self, frame: RGBDFrame, table: TableFrame, candidates: Sequence[Candidate], first_free: int) -> None:
        self.frame, self.table = frame, table
        self.kept = {item.id: item for item in candidates}
        self.dropped: dict[int, str] = {}
        self.parts: dict[SegmentName, int] = {}  # the numbers of the parts of divided segments, by name
        self.merged: dict[int, int] = {}  # the segment that a piece became part of
        self.notes: list[str] = []
        self.free = max([first_free, *(number + 1 for number in self.kept)])

    def find(self, name: SegmentName) -> tuple[int, str]:
        """The number of a segment, and the reason why it may not change; the reason is empty if it may."""
        number = self.parts.get(name, name)
        if not isinstance(number, int) or number not in self.kept.keys() | self.dropped.keys():
            return 0, f"there is no segment {name}"
        if number in self.dropped:
            return number, f"segment {name} is gone: {self.dropped[number]}"
        return number, f"the mask of segment {name} was given" if self.kept[number].given else ""

    def merge(self, numbers: Sequence[int], mask: Mask) -> bool:
        """Put a segment with ``mask`` (H, W) in place of the pieces ``numbers``, if it can be measured."""
        new = self.replace_with([mask], numbers)
        for number in numbers if new else ():
            self.dropped[number] = f"a piece of a larger thing, candidate {new[0]}"
            self.merged[number] = new[0]
        return bool(new)

    def replace_with(self, masks: Sequence[Mask], numbers: Sequence[int]) -> list[int]:
        """Measure new segments with ``masks`` (H, W) in place of the segments ``numbers``.

        Returns:
            The numbers of the new segments; empty if a mask has too few measured pixels or is too large for an object:
            then nothing changes.
        """
        rest = [item.mask for number, item in self.kept.items() if number not in numbers]
        measured = measure_beside_others(self.frame, self.table, masks, rest)
        least = SMALLEST * self.frame.depth.size
        if measured is None or any(item.points < least for item in measured):
            return []
        for number in numbers:
            del self.kept[number]
        new = list(range(self.free, self.free + len(measured)))
        self.kept |= {number: replace(item, id=number) for number, item in zip(new, measured, strict=True)}
        self.free += len(new)
        return new


def regroup_segments(
    frame: RGBDFrame,
    table: TableFrame,
    candidates: Sequence[Candidate],
    robot: Mask,
    said: Regrouping,
    first_free: int = 1,
) -> RegroupedSegments:
    """Apply the statements that geometry bears out: divided segments first, then scenery, merged and missing objects.

    Segments with a given mask do not change. If no object would remain, nothing is applied.

    Args:
        frame: the photo.
        table: the table in it.
        candidates: the segments.
        robot: (H, W) pixels known to show the robot.
        said: the statements.
        first_free: the smallest number of a new segment.
    """
    segments = _Segments(frame, table, candidates, first_free)
    for number, boxes in said.divided:
        _divide(segments, number, boxes)
    scenery = np.zeros(frame.depth.shape, np.bool_)
    for segment, name in said.scenery:
        number, reason = segments.find(segment)
        if reason:
            segments.notes.append(f"{name or 'scenery'}: {reason}")
            continue
        scenery |= segments.kept.pop(number).mask
        segments.dropped[number] = f"scenery: {name or 'no object'}"
    for group in said.merged:
        _merge(segments, group)
    for name, box, whole in said.missing:
        _add(segments, name or "an object", box, whole, robot)
    if not segments.kept:
        note = f"none of the {len(candidates)} segments would be an object: the segmentation stays as it is"
        return RegroupedSegments(tuple(candidates), (), np.zeros_like(scenery), (*segments.notes, note))
    dropped = tuple(DroppedCandidate(id=number, reason=reason) for number, reason in sorted(segments.dropped.items()))
    for item in segments.kept.values():
        scenery &= ~item.mask  # a missing object may lie in what was taken for scenery
    return RegroupedSegments(tuple(segments.kept.values()), dropped, scenery, tuple(segments.notes))


def _divide(segments: _Segments, number: int, boxes: Sequence[PixelBox]) -> None:
    """Divide a segment at the borders of colour and depth between ``boxes``."""
    _, reason = segments.find(number)
    if reason:
        segments.notes.append(f"not divided: {reason}")
        return
    parts = divide_mask_by_boxes(segments.frame, segments.kept[number].mask, boxes)
    masks = [mask for mask in parts if mask.any()]
    if len(masks) < 2:
        segments.notes.append(f"segment {number} is not divided: fewer than two of its parts have pixels of their own")
        return
    new = segments.replace_with(masks, [number])
    if not new:
        counts = ", ".join(str(np.count_nonzero(segments.frame.depth[mask] > 0)) for mask in masks)
        least = SMALLEST * segments.frame.depth.size
        segments.notes.append(
            f"segment {number} is not divided: its parts have {counts} measured pixels, not {least:.0f} each"
        )
        return
    segments.dropped[number] = f"several objects: candidates {', '.join(map(str, new))}"
    letters = [letter for letter, mask in zip(ascii_lowercase, parts, strict=False) if mask.any()]
    segments.parts |= {f"{number}{letter}": part for letter, part in zip(letters, new, strict=False)}


def divide_mask_by_boxes(frame: RGBDFrame, mask: Mask, boxes: Sequence[PixelBox]) -> list[Mask]:
    """Divide the mask (H, W) of a segment into the objects in ``boxes``, and the rest beyond the boxes, if any.

    The core of each box is a marker of a watershed over colour and depth. Where boxes overlap, pixels are undecided,
    unless a box lies mostly within the other.

    Returns:
        The parts (H, W) in the order of the boxes, and the rest; they may be empty.
    """
    window = grow_window(mask_bounding_slices(mask), 1)
    inside, rgb, depth = mask[window], frame.rgb[window], frame.depth[window]
    if not inside.any():
        return [np.zeros_like(mask) for _ in range(len(boxes) + 1)]
    top, left = window[0].start, window[1].start
    rows, columns = np.indices(inside.shape)
    rows, columns = rows + top, columns + left

    def pixels_in_box(box: PixelBox, grown: float) -> Mask:
        x, y, wide, high = box
        return (np.abs(columns - x - wide / 2) <= (0.5 + grown) * wide) & (
            np.abs(rows - y - high / 2) <= (0.5 + grown) * high
        )

    whole = [inside & pixels_in_box(box, 0) for box in boxes]
    areas = [max(1, np.count_nonzero(box)) for box in whole]
    markers = np.where(inside, 0, len(boxes) + 2).astype(np.int32)
    far = inside.copy()
    for index, box in enumerate(boxes):
        core = inside & pixels_in_box(box, -CONFIG.margin)
        far &= ~pixels_in_box(box, CONFIG.margin)
        for rival, area in enumerate(areas):
            within = np.count_nonzero(whole[index] & whole[rival]) >= CONFIG.within * areas[index]
            if rival != index and not (within and areas[index] < area):
                core &= ~whole[rival]
        markers[core] = index + 1
    if np.count_nonzero(far) >= SMALLEST * frame.depth.size:
        markers[far] = len(boxes) + 1
    owners = cv2.watershed(_colour_and_depth(rgb, depth, inside), markers.copy())
    owners = np.where(inside & (owners <= len(boxes) + 1), owners, 0)
    for _ in range(max(inside.shape)):  # watershed lines go to a neighbour
        lines = inside & (owners <= 0)
        if not lines.any() or not (owners > 0).any():
            break
        grown = cv2.dilate(np.maximum(owners, 0).astype(np.float32), np.ones((3, 3), np.uint8))
        owners = np.where(lines, grown, owners).astype(np.int32)
    parts = [np.zeros_like(mask) for _ in range(len(boxes) + 1)]
    for label, part in enumerate(parts, 1):
        part[window] = owners == label
    return parts


def _colour_and_depth(rgb: Image, depth: npt.NDArray[np.float32], inside: Mask) -> Image:
    """A picture (H, W, 3) uint8 of the two principal components of a segment's colours, and its depth."""
    lab = cv2.cvtColor(rgb, cv2.COLOR_RGB2LAB).astype(np.float64)
    colors = lab - lab[inside].mean(axis=0)
    components = np.linalg.svd(np.cov(colors[inside].T))[0][:, :2]
    picture = np.full((*inside.shape, 3), 128.0)
    picture[..., :2] += colors @ components
    measured = inside & (depth > 0)
    if measured.any():
        near, distant = np.percentile(depth[measured], (1, 99))
        _, found = cv2.distanceTransformWithLabels(
            (~measured).astype(np.uint8), cv2.DIST_L2, 3, labelType=cv2.DIST_LABEL_PIXEL
        )
        nearest = np.asarray(found, np.int32)
        values = np.zeros(int(nearest.max()) + 1)
        values[nearest[measured]] = depth[measured]
        picture[..., 2] = (values[nearest] - near) / max(distant - near, CONFIG.deep) * 255
    return np.clip(picture, 0, 255).astype(np.uint8)


def _merge(segments: _Segments, group: Sequence[SegmentName]) -> None:
    """Merge the segments of a group that adjoin each other in the photo and in space."""
    members: list[int] = []
    for name in dict.fromkeys(group):
        number, reason = segments.find(name)
        if reason:
            segments.notes.append(f"not merged: {reason}")
        else:
            members.append(number)
    if len(members) < 2:
        return
    kept, gap = segments.kept, CONFIG.gap * max(segments.frame.depth.shape)
    hidden = segments.frame.depth <= 0
    for number, item in kept.items():
        if number not in members:
            hidden |= item.mask
    reached, rest = members[:1], members[1:]
    for member in reached:  # grows while segments adjoin it
        near = [
            number
            for number in rest
            if gap_between_boxes(kept[member].box, kept[number].box) <= CONFIG.apart
            and _measure_visible_gap(kept[member].mask, kept[number].mask, hidden) <= gap
        ]
        reached += near
        rest = [number for number in rest if number not in near]
    if rest:
        apart = f"{gap:.0f} visible pixels or {100 * CONFIG.apart:.0f} cm"
        segments.notes.append(f"{_name(rest)} not merged with {', '.join(map(str, reached))}: more than {apart} apart")
    if len(reached) < 2:
        return
    if not segments.merge(reached, np.any([kept[member].mask for member in reached], axis=0)):
        largest = f"an object of more than {DEFAULT.measuring.largest:g} m"
        segments.notes.append(f"{_name(reached)} not merged: together they would be {largest}")


def _measure_visible_gap(first: Mask, second: Mask, hidden: Mask) -> float:
    """Pixels between the nearest points of two masks (H, W), without those that are ``hidden`` (H, W)."""
    distance, nearest = cv2.distanceTransformWithLabels(
        (~first).astype(np.uint8), cv2.DIST_L2, 5, labelType=cv2.DIST_LABEL_PIXEL
    )
    start = np.argwhere(second)[distance[second].argmin()]
    (end,) = np.argwhere(first & (nearest == nearest[tuple(start)]))[:1]
    length = float(np.linalg.norm(end - start))
    steps = np.linspace(0, 1, max(2, round(length) + 1))[1:-1, None]
    rows, columns = np.rint(start + steps * (end - start)).astype(np.int64).T
    return length * float(np.mean(~hidden[rows, columns])) if len(rows) else 0.0


def _add(segments: _Segments, name: str, box: PixelBox, whole: SegmentName | None, robot: Mask) -> None:
    """Add an object: the largest surface in ``box`` of measured pixels above the table that no segment owns.

    The rest of the object that the segment ``whole`` shows in part is added to that segment instead.
    """
    frame = segments.frame
    x, y, wide, high = box
    height, width = frame.depth.shape
    left, top = max(0, round(x)), max(0, round(y))
    right, bottom = min(width, round(x + wide)), min(height, round(y + high))
    if right <= left or bottom <= top:
        segments.notes.append(f"{name} is not added: its box is outside of the photo")
        return
    window = np.s_[top:bottom, left:right]
    owned = robot[window].copy()
    for item in segments.kept.values():
        owned |= item.mask[window]
    if whole is not None:
        _complete(segments, name, whole, window, ~owned)
        return
    points = robot_frame_point_map(frame, segments.table)[window]
    noise = max(DEFAULT.coverage.lowest, DEFAULT.coverage.deviations * segments.table.residual)
    above = (points[..., 2] > noise) & (frame.depth[window] > 0) & ~robot[window]
    free = above & ~owned
    least = SMALLEST * frame.depth.size
    if np.count_nonzero(free) < least:
        taken = "belongs to segments" if np.count_nonzero(above) >= least else "is on the table, or was not measured"
        segments.notes.append(f"{name} is not added: what its box shows {taken}")
        return
    raised, coloured = np.count_nonzero(free), _cut_out_by_colour(frame.rgb, window, ~owned)
    differs = np.count_nonzero(coloured) >= CONFIG.seen * coloured.size  # else its colours are those around it
    both = np.count_nonzero(free & coloured)
    if differs and (both >= CONFIG.left * raised or raised < CONFIG.full * free.size):
        free &= coloured
    if np.count_nonzero(free) < least:
        segments.notes.append(f"{name} is not added: it is on the table, or was not measured")
        return
    depth = frame.depth[window]
    square = np.ones((3, 3), np.uint8)
    jumps = cv2.morphologyEx(np.where(free, depth, np.float32(0)), cv2.MORPH_GRADIENT, square) > CONFIG.jump * depth
    jumps &= cv2.erode(free.astype(np.uint8), square) > 0
    surfaces = pixels_by_label(label_connected_components((free & ~jumps).astype(np.uint8), 1))
    mask = np.zeros(frame.depth.shape, np.bool_)
    part = np.zeros_like(free)
    part.put(max(surfaces, key=len), True)
    mask[window] = part | (cv2.dilate(part.astype(np.uint8), square) > 0) & free
    if not segments.replace_with([mask], []):
        segments.notes.append(
            f"{name} is not added: its largest surface has {np.count_nonzero(mask)} pixels, or is "
            f"more than {DEFAULT.measuring.largest:g} m long"
        )


def _complete(segments: _Segments, name: str, whole: SegmentName, window: tuple[slice, slice], free: Mask) -> None:
    """Add the ``free`` pixels (h, w) of a window that have the colours of a segment, and adjoin it, to the segment.

    They may be flat, or without depth: the sides of a low object are lost in the table's noise.
    """
    number, reason = segments.find(whole)
    while number in segments.merged:
        number, reason = segments.find(segments.merged[number])
    if reason:
        segments.notes.append(f"{name} is not added: {reason}")
        return
    mask = segments.kept[number].mask
    if not mask[window].any():
        segments.notes.append(f"{name} is not added: segment {whole} is not in its box")
        return
    coloured = _cut_out_by_colour(segments.frame.rgb, window, free, mask[window])
    joined = mask.copy()
    joined[window] |= coloured
    labels = label_connected_components(joined.astype(np.uint8), 1)
    joined &= np.isin(labels, labels[mask])
    added = np.count_nonzero(joined & ~mask)
    if added < SMALLEST * mask.size:
        segments.notes.append(f"{name} is not added: {added} pixels beside segment {whole} have its colours")
    elif not segments.merge([number], joined):
        largest = f"an object of more than {DEFAULT.measuring.largest:g} m"
        segments.notes.append(f"{name} is not added: with segment {whole} it would be {largest}")


def _cut_out_by_colour(rgb: Image, window: tuple[slice, slice], free: Mask, sure: Mask | None = None) -> Mask:
    """The pixels of ``free`` (h, w), in a window of the photo, whose colours differ from those around the window.

    GrabCut (Rother et al., SIGGRAPH 2004). Pixels that are not ``free`` are background, except those that are ``sure``
    (h, w) to show the object.
    """
    high, wide = free.shape
    around = grow_window(window, max(CONFIG.rim, round(CONFIG.margin * max(high, wide))))
    top, left = window[0].start - around[0].start, window[1].start - around[1].start
    inner = np.s_[top : top + high, left : left + wide]
    picture = rgb[around]
    rows, columns, _ = picture.shape
    marks = np.full((rows, columns), cv2.GC_BGD, np.uint8)
    marks[inner][free] = cv2.GC_PR_FGD
    if sure is not None:
        marks[inner][sure] = cv2.GC_FGD
    scale = min(1.0, CONFIG.cut / max(rows, columns))
    size = max(1, round(scale * columns)), max(1, round(scale * rows))
    small = np.asarray(cv2.resize(marks, size, interpolation=cv2.INTER_NEAREST), np.uint8)
    counts = np.bincount(small.ravel(), minlength=4)
    if min(counts[cv2.GC_BGD], counts[cv2.GC_FGD] + counts[cv2.GC_PR_FGD]) < CONFIG.colors:
        return np.zeros_like(free)
    cv2.setRNGSeed(0)
    shrunk, models = cv2.resize(picture, size, interpolation=cv2.INTER_AREA), np.zeros((2, 65))
    cv2.grabCut(shrunk, small, (0, 0, 1, 1), models[:1], models[1:], 3, cv2.GC_INIT_WITH_MASK)
    kept = cv2.resize(small, (columns, rows), interpolation=cv2.INTER_NEAREST)[inner]
    return free & ((kept == cv2.GC_FGD) | (kept == cv2.GC_PR_FGD))


def _name(numbers: Sequence[int]) -> str:
    words = "segment" if len(numbers) == 1 else "segments"
    return f"{words} {', '.join(map(str, numbers))} {'is' if len(numbers) == 1 else 'are'}"
