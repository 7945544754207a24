"""A segment that is two things is cut in two; a thing that is about convex, or hollow, stays whole."""

from collections.abc import Sequence

import numpy as np
import pytest

from grs_agents.perception.segmentation.splitting import split
from grs_agents.perception.types import Array

Corners = tuple[tuple[float, float, float], tuple[float, float, float]]
SIDE = 40
"""Each face is a picture of so many pixels a side."""


def faces_of(low: Sequence[float], high: Sequence[float]) -> list[Array]:
    """The three faces (SIDE, SIDE, 3) of a box that a camera sees: its top, and its sides towards -x and -y; m."""
    start, (x, y, z) = np.array(low), np.subtract(high, low)
    edges = [((0, 0, z), (x, 0, 0), (0, y, 0)), ((0, 0, 0), (0, y, 0), (0, 0, z)), ((0, 0, 0), (x, 0, 0), (0, 0, z))]
    one, two = (part[..., None] for part in np.meshgrid(*2 * [np.linspace(0, 1, SIDE)], indexing="ij"))
    return [start + corner + one * along + two * across for corner, along, across in np.array(edges)]


def points_of(*boxes: Corners) -> Array:
    """(H, W, 3) points of boxes, face below face."""
    return np.concatenate([face for low, high in boxes for face in faces_of(low, high)])


BOOK: Corners = ((0.0, 0.0, 0.0), (0.2, 0.2, 0.02))
BOTTLE: Corners = ((0.06, 0.06, 0.02), (0.11, 0.11, 0.2))


def test_a_bottle_on_a_book_is_two_things() -> None:
    points = points_of(BOOK, BOTTLE)
    found = split(np.ones(points.shape[:2], np.int32), points, 100)
    assert found.max() == 2
    book, bottle = found[: 3 * SIDE], found[3 * SIDE :]
    assert (book == book[0, 0]).mean() > 0.95 and (bottle != book[0, 0]).mean() > 0.9


def test_other_labels_stay() -> None:
    points = points_of(BOOK, BOTTLE)
    labels = np.repeat(np.array([1, 2], np.int32), 3 * SIDE)[:, None].repeat(SIDE, axis=1)
    assert (split(labels, points, 100) == labels).all()


@pytest.mark.parametrize(
    "boxes",
    [[BOOK], [BOTTLE], [BOOK, ((0.02, 0.02, 0.02), (0.18, 0.18, 0.03))]],
    ids=["a book", "a bottle", "a box with a lid"],
)
def test_one_thing_stays_whole(boxes: list[Corners]) -> None:
    points = points_of(*boxes)
    assert split(np.ones(points.shape[:2], np.int32), points, 100).max() == 1


def test_an_open_box_stays_whole() -> None:
    walls: list[Corners] = [
        ((0.0, 0.0, 0.0), (0.3, 0.005, 0.09)),
        ((0.0, 0.0, 0.0), (0.005, 0.2, 0.09)),
        ((0.295, 0.0, 0.0), (0.3, 0.2, 0.09)),
        ((0.0, 0.195, 0.0), (0.3, 0.2, 0.09)),
        ((0.0, 0.0, 0.0), (0.3, 0.2, 0.005)),
    ]
    points = points_of(*walls)
    assert split(np.ones(points.shape[:2], np.int32), points, 100).max() == 1


def test_what_is_not_measured_stays_in_its_segment() -> None:
    points = points_of(BOOK, BOTTLE)
    points[10:20, 10:20] = np.nan
    assert (split(np.ones(points.shape[:2], np.int32), points, 100) > 0).all()
