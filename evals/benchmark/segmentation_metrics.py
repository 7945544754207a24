"""Segmentation metrics against ground truth: overlaps, F1, splits and merges. Pure functions of labels."""

from collections.abc import Sequence
from dataclasses import dataclass
from importlib import import_module

import numpy as np
import numpy.typing as npt

from grs_agents.perception.image_geometry import Labels
from grs_agents.perception.types import Array

Counts = npt.NDArray[np.int64]
MATCHED = 0.5
"""A segment and an object are matched if their intersection over union is at least this."""
FRAGMENT = 0.1
"""A part of an object counts as a fragment, or as swallowed, from this share of the object's pixels."""
MOSTLY = 0.5
"""A segment lies mostly in an object from this share of the segment's pixels."""


@dataclass(frozen=True)
class Overlaps:
    """Pixels shared by segments and objects.

    Attributes:
        truths: (T,) labels of the objects that count.
        segments: (S,) labels of the segments that count.
        shared: (T, S) pixels of object t in segment s.
        truth_areas, segment_areas: (T,), (S,) pixels.
    """

    truths: Counts
    segments: Counts
    shared: Counts
    truth_areas: Counts
    segment_areas: Counts

    @property
    def ious(self) -> Array:
        """(T, S) intersection over union."""
        union = self.truth_areas[:, None] + self.segment_areas[None] - self.shared
        return self.shared / np.maximum(union, 1)

    def pairs(self) -> list[tuple[int, int]]:
        """The one-to-one assignment (rows of ``truths``, of ``segments``) with maximal intersection over union."""
        rows, columns = import_module("scipy.optimize").linear_sum_assignment(self.ious, maximize=True)
        both = zip(rows.tolist(), columns.tolist(), strict=True)
        return [(row, column) for row, column in both if self.ious[row, column] > 0]

    def matched(self) -> dict[int, int]:
        """The label of the object that each matched segment shows, by the segment's number."""
        return {
            int(self.segments[column]): int(self.truths[row])
            for row, column in self.pairs()
            if self.ious[row, column] >= MATCHED
        }


@dataclass(frozen=True)
class SegmentationScore:
    """The counts of a picture; counts of several pictures are added.

    Attributes:
        objects, segments: their numbers.
        hits: matched pairs at an intersection over union of 0.5 and 0.75.
        iou_of_matched: sum of the intersection over union of the pairs matched at 0.5.
        iou_of_objects: sum over all objects of that of their assigned segment, 0 without a segment.
        split: objects of which two or more segments each hold a fragment and lie mostly in it.
        merged: objects that share a segment with another object, each with the larger part of its pixels.
    """

    objects: int
    segments: int
    hits: tuple[int, int]
    iou_of_matched: float
    iou_of_objects: float
    split: int
    merged: int

    @property
    def mean_iou(self) -> float:
        """Mean intersection over union of matched instances; NaN without a match."""
        return self.iou_of_matched / self.hits[0] if self.hits[0] else float("nan")

    @property
    def mean_iou_of_objects(self) -> float:
        """Mean over all objects; an object without a segment counts 0."""
        return self.iou_of_objects / self.objects if self.objects else float("nan")

    @property
    def f1(self) -> tuple[float, float]:
        """F1 of the instances at 0.5 and 0.75; 1 without objects and segments."""
        both = self.objects + self.segments
        return (2 * self.hits[0] / both, 2 * self.hits[1] / both) if both else (1.0, 1.0)

    @property
    def over_segmentation(self) -> float:
        """Share of the objects that are split."""
        return self.split / max(self.objects, 1)

    @property
    def under_segmentation(self) -> float:
        """Share of the objects that are merged with another."""
        return self.merged / max(self.objects, 1)


def overlaps(predicted: Labels, truth: Labels, ignored: frozenset[int] = frozenset()) -> Overlaps:
    """Compare two (H, W) label pictures, 0 = background.

    Args:
        predicted: the segments.
        truth: the objects.
        ignored: labels of objects that need not be found; segments that lie mostly in them do not count either.
    """
    if predicted.shape != truth.shape:
        raise ValueError(f"segments of shape {predicted.shape} cannot be compared with a truth of shape {truth.shape}")
    rows, columns = int(truth.max(initial=0)) + 1, int(predicted.max(initial=0)) + 1
    pairs = truth.astype(np.int64).ravel() * columns + predicted.ravel()
    table = np.bincount(pairs, minlength=rows * columns).reshape(rows, columns)
    sizes, areas = table.sum(axis=1), table.sum(axis=0)
    passed = np.array([label in ignored for label in range(rows)], np.bool_)
    lost = table[passed].sum(axis=0) > MOSTLY * areas
    truths = np.flatnonzero((sizes > 0) & ~passed & (np.arange(rows) > 0))
    segments = np.flatnonzero((areas > 0) & ~lost & (np.arange(columns) > 0))
    return Overlaps(truths, segments, table[np.ix_(truths, segments)], sizes[truths], areas[segments])


def score_segmentation(predicted: Labels, truth: Labels, ignored: frozenset[int] = frozenset()) -> SegmentationScore:
    """Score the segments ``predicted`` (H, W) against the objects ``truth`` (H, W); see `overlaps` for ``ignored``.

    Splits and merges follow the idea of Hoover et al., "An experimental comparison of range image segmentation
    algorithms", 1996.
    """
    common = overlaps(predicted, truth, ignored)
    pairs, ious = common.pairs(), common.ious
    assigned = np.array([ious[pair] for pair in pairs])
    fragment = common.shared >= FRAGMENT * common.truth_areas[:, None]
    mostly = common.shared >= MOSTLY * common.segment_areas[None]
    larger = common.shared > MOSTLY * common.truth_areas[:, None]
    return SegmentationScore(
        objects=len(common.truths),
        segments=len(common.segments),
        hits=(int((assigned >= MATCHED).sum()), int((assigned >= 0.75).sum())),
        iou_of_matched=float(assigned[assigned >= MATCHED].sum()),
        iou_of_objects=float(assigned.sum()),
        split=int(((fragment & mostly).sum(axis=1) >= 2).sum()),
        merged=int(larger[:, larger.sum(axis=0) >= 2].any(axis=1).sum()),
    )


def sum_scores(scores: Sequence[SegmentationScore]) -> SegmentationScore:
    """The score of several pictures together, each object counting alike."""

    def add(name: str) -> int:
        return sum(getattr(score, name) for score in scores)

    return SegmentationScore(
        objects=add("objects"),
        segments=add("segments"),
        hits=(sum(score.hits[0] for score in scores), sum(score.hits[1] for score in scores)),
        iou_of_matched=sum(score.iou_of_matched for score in scores),
        iou_of_objects=sum(score.iou_of_objects for score in scores),
        split=add("split"),
        merged=add("merged"),
    )
