"""The kitting outlines keep to the table of symmetries that published programs score by."""

import math

import numpy as np
import numpy.typing as npt
import pytest

from evals.synthesis.polygons import area, convex_pieces
from scripts.assets.kitting import convex_outline_pieces
from scripts.assets.outlines import REACH, ROUND, Outline, outlines

WHOLE = 2 * math.pi
PUBLISHED = (
    *(WHOLE, WHOLE, WHOLE / 3, WHOLE / 4, WHOLE / 4, WHOLE, math.pi, WHOLE / 5, math.pi, WHOLE / 4),
    *(WHOLE / 5, 0, WHOLE, WHOLE, WHOLE, WHOLE, 0, WHOLE / 6, WHOLE, WHOLE),
)
SHAPES = outlines()
EVERY = pytest.mark.parametrize("shape", SHAPES, ids=lambda shape: shape.name)


def turned(corners: npt.NDArray[np.float64], angle: float) -> npt.NDArray[np.float64]:
    """The corners after a turn about the origin."""
    c, s = math.cos(angle), math.sin(angle)
    return corners @ np.array([[c, s], [-s, c]])


def same(corners: npt.NDArray[np.float64], angle: float) -> bool:
    """Whether a turn maps the corners onto themselves, in the same round."""
    after = turned(corners, angle)
    return any(np.allclose(np.roll(after, step, axis=0), corners, atol=1e-6) for step in range(len(corners)))


def test_the_symmetries_are_the_published_ones() -> None:
    assert [shape.symmetry for shape in SHAPES] == pytest.approx(PUBLISHED)
    assert len({shape.name for shape in SHAPES}) == 20


@EVERY
def test_an_outline_has_exactly_the_symmetry_it_says(shape: Outline) -> None:
    steps = [2 * math.pi * step / 360 for step in range(1, 360)]
    unchanged = [angle for angle in steps if same(shape.corners, angle)]
    if shape.folds == 0:
        assert same(shape.corners, 2 * math.pi / ROUND)
        assert np.allclose(np.linalg.norm(shape.corners, axis=1), np.linalg.norm(shape.corners[0]))
    else:
        expected = [2 * math.pi * step / shape.folds for step in range(1, shape.folds)]
        assert unchanged == pytest.approx(expected)
    if shape.hole is not None:
        assert same(shape.hole, 2 * math.pi / ROUND)


@EVERY
def test_a_shape_fits_its_place_in_a_kit(shape: Outline) -> None:
    assert area(shape.corners) > 0
    assert np.linalg.norm(shape.corners, axis=1).max() <= REACH
    assert np.ptp(shape.corners, axis=0).max() * 0.003 <= 0.08
    if shape.folds == 1:
        assert np.allclose(shape.corners.min(axis=0) + shape.corners.max(axis=0), 0)


@EVERY
def test_convex_pieces_cover_a_shape_and_no_more(shape: Outline) -> None:
    found = convex_outline_pieces(shape)
    whole = area(shape.corners) - (0 if shape.hole is None else area(shape.hole))
    assert sum(area(piece) for piece in found) == pytest.approx(whole, rel=0.02 if shape.hole is not None else 1e-9)
    assert len(found) <= 16
    for piece in found:
        sides = np.roll(piece, -1, axis=0) - piece
        following = np.roll(sides, -1, axis=0)
        assert (sides[:, 0] * following[:, 1] - sides[:, 1] * following[:, 0]).min() > -1e-9


def test_a_clockwise_polygon_is_refused() -> None:
    with pytest.raises(ValueError, match="clockwise"):
        convex_pieces(SHAPES[0].corners[::-1])
