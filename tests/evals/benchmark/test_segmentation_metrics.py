"""Scores of segmentations: bounds, invariances, and what each kind of mistake costs."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from evals.benchmark.segmentation_metrics import overlaps, score_segmentation, sum_scores

LABELS = arrays(np.int32, (12, 16), elements=st.integers(0, 4))


def pictures(*boxes: tuple[int, int, int, int]) -> np.ndarray:
    """(60, 80) labels: one rectangle (top, bottom, left, right) for each number."""
    labels = np.zeros((60, 80), np.int32)
    for number, (top, bottom, left, right) in enumerate(boxes, 1):
        labels[top:bottom, left:right] = number
    return labels


LEFT, RIGHT = (10, 40, 10, 30), (10, 40, 40, 60)


@given(truth=LABELS)
def test_the_truth_itself_is_perfect(truth: np.ndarray) -> None:
    made = score_segmentation(truth, truth)
    assert made.f1 == (1.0, 1.0)
    assert (made.split, made.merged) == (0, 0)
    assert np.isnan(made.mean_iou) if not truth.any() else made.mean_iou == 1.0


@given(found=LABELS, truth=LABELS)
def test_scores_keep_their_bounds(found: np.ndarray, truth: np.ndarray) -> None:
    made = score_segmentation(found, truth)
    assert 0 <= made.f1[1] <= made.f1[0] <= 1
    assert 0 <= made.over_segmentation <= 1
    assert 0 <= made.under_segmentation <= 1
    assert np.isnan(made.mean_iou) or 0.5 <= made.mean_iou <= 1
    assert made.iou_of_matched <= made.iou_of_objects + 1e-9


@given(found=LABELS, truth=LABELS, order=st.permutations(range(1, 5)))
def test_numbers_mean_nothing(found: np.ndarray, truth: np.ndarray, order: list[int]) -> None:
    renumbered = np.array([0, *order], np.int32)[found]
    ours, theirs = score_segmentation(found, truth), score_segmentation(renumbered, truth)
    assert ours.f1 == theirs.f1
    assert (ours.split, ours.merged) == (theirs.split, theirs.merged)
    assert ours.iou_of_objects == pytest.approx(theirs.iou_of_objects)


@given(found=LABELS, truth=LABELS)
def test_f1_and_overlaps_do_not_care_which_is_the_truth(found: np.ndarray, truth: np.ndarray) -> None:
    one, other = score_segmentation(found, truth), score_segmentation(truth, found)
    assert one.f1 == other.f1
    assert one.iou_of_objects == pytest.approx(other.iou_of_objects)


@given(truth=LABELS, missing=st.integers(1, 4))
def test_a_missed_object_costs_recall_alone(truth: np.ndarray, missing: int) -> None:
    made = score_segmentation(np.where(truth == missing, 0, truth), truth)
    there = len(np.unique(truth[truth > 0]))
    lost = int((truth == missing).any())
    assert made.hits[0] == there - lost
    assert made.f1[0] == pytest.approx(2 * (there - lost) / (2 * there - lost) if there else 1.0)


def test_a_split_object_is_counted_once() -> None:
    truth = pictures((10, 40, 10, 30), RIGHT)
    found = pictures((10, 25, 10, 30), RIGHT, (25, 40, 10, 30))
    made = score_segmentation(found, truth)
    assert (made.split, made.merged) == (1, 0)
    assert made.hits == (2, 1)


def test_a_crumb_is_no_split() -> None:
    found = pictures((10, 40, 10, 29), RIGHT, (10, 40, 29, 30))
    assert score_segmentation(found, pictures(LEFT, RIGHT)).split == 0


def test_objects_in_one_segment_are_merged() -> None:
    made = score_segmentation(pictures((10, 40, 10, 60)), pictures(LEFT, RIGHT, (45, 55, 10, 60)))
    assert (made.split, made.merged) == (0, 2)
    assert made.under_segmentation == pytest.approx(2 / 3)


def test_ignored_objects_and_what_lies_in_them_do_not_count() -> None:
    truth = pictures(LEFT, RIGHT)
    assert score_segmentation(pictures(LEFT, RIGHT), truth, frozenset({2})).f1 == (1.0, 1.0)
    assert score_segmentation(pictures(LEFT), truth, frozenset({2})).f1 == (1.0, 1.0)
    assert score_segmentation(pictures(LEFT, (45, 55, 40, 60)), truth, frozenset({2})).f1[0] == pytest.approx(2 / 3)


def test_totals_add_up() -> None:
    one, other = (
        score_segmentation(pictures(LEFT), pictures(LEFT)),
        score_segmentation(pictures(LEFT), pictures(LEFT, RIGHT)),
    )
    both = sum_scores([one, other])
    assert (both.objects, both.segments, both.hits) == (3, 2, (2, 2))
    assert both.f1[0] == pytest.approx(4 / 5)
    assert both.mean_iou == 1.0


def test_pictures_of_different_sizes_are_refused() -> None:
    with pytest.raises(ValueError, match="shape"):
        overlaps(np.zeros((3, 4), np.int32), np.zeros((4, 3), np.int32))
