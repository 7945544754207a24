"""The twenty outlines of the kitting shapes with their rotational symmetries.

Published programs score shape NN's yaw by the NNth symmetry of a common table, so the outlines keep to it.
Coordinates are in the units of the meshes, which programs scale by 0.003 to metres: no shape is longer than 8 cm,
none reaches further from its origin than half the 9 cm between the holes of a kit, and strokes carry a suction
cup. A rotation about the origin is a rotation in place.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from evals.synthesis.polygons import Floats, area

REACH = 14.6
"""Largest distance of a corner from the origin."""
ROUND = 48
"""Corners of a circle."""
_HOLE = 6.5


@dataclass(frozen=True)
class Outline:
    """A kitting shape seen from above.

    Attributes:
        name: in words.
        corners: (N, 2) counter-clockwise.
        folds: order of its rotational symmetry; 0 for round shapes.
        hole: (N, 2) the inner edge of a ring, else None.
    """

    name: str
    corners: Floats
    folds: int
    hole: Floats | None = None

    @property
    def symmetry(self) -> float:
        """The smallest rotation (rad) that maps it onto itself; 0 for round shapes, 2 pi without symmetry."""
        return 2 * math.pi / self.folds if self.folds else 0.0


def outlines() -> tuple[Outline, ...]:
    """The shapes by number, 0 to 19."""
    arm = np.array([(3.6, 3.6), (3.6, 11.5), (-3.6, 11.5)])
    turns = [np.array([[0.0, -1.0], [1.0, 0.0]])] * 4
    corners = [arm]
    for turn in turns[1:]:
        corners.append(corners[-1] @ turn.T)
    tips, dents = regular_polygon(5, 13.2), regular_polygon(5, 6.6, math.pi / 2 + math.pi / 5)
    lobe = [(5.2 + 5.4 * math.cos(a), 4.5 + 5.4 * math.sin(a)) for a in np.linspace(-0.55, math.pi - 0.3, 10)]
    return (
        _drawn("letter R", _LETTER_R),
        _drawn("letter A", _LETTER_A),
        Outline("triangle", regular_polygon(3, 13.0), 3),
        Outline("square", regular_polygon(4, 10 * math.sqrt(2), math.pi / 4), 4),
        Outline("plus", np.vstack(corners), 4),
        _drawn("letter T", _LETTER_T),
        Outline("diamond", np.array([(13.0, 0), (0, 8.5), (-13.0, 0), (0, -8.5)]), 2),
        Outline("pentagon", regular_polygon(5, 12.0), 5),
        Outline("rectangle", np.array([(11.5, 6.5), (-11.5, 6.5), (-11.5, -6.5), (11.5, -6.5)]), 2),
        Outline("flower", polar_outline(lambda angle: 9.6 + 2.9 * math.cos(4 * angle)), 4),
        Outline("star", np.stack([tips, dents], axis=1).reshape(-1, 2), 5),
        Outline("circle", regular_polygon(ROUND, 11.0), 0),
        _drawn("letter G", _LETTER_G),
        _drawn("letter V", _LETTER_V),
        _drawn("letter E", _LETTER_E),
        _drawn("letter L", _LETTER_L),
        Outline("ring", regular_polygon(ROUND, 12.5), 0, regular_polygon(ROUND, _HOLE)),
        Outline("hexagon", regular_polygon(6, 11.5), 6),
        _drawn("heart", [(0.0, -11.5), *lobe, (0.0, 5.2), *[(-x, y) for x, y in reversed(lobe)]]),
        _drawn("letter M", _LETTER_M),
    )


def regular_polygon(count: int, radius: float, first: float = math.pi / 2) -> Floats:
    """A regular polygon (count, 2) around the origin, its first corner at the angle ``first`` (rad)."""
    angles = first + np.arange(count) * 2 * np.pi / count
    return radius * np.stack([np.cos(angles), np.sin(angles)], axis=1)


def polar_outline(radius: Callable[[float], float]) -> Floats:
    """A smooth closed curve (ROUND, 2) around the origin, its radius a function of the angle (rad)."""
    angles = [2 * math.pi * step / ROUND for step in range(ROUND)]
    return np.array([(radius(a) * math.cos(a), radius(a) * math.sin(a)) for a in angles])


def _drawn(name: str, corners: Sequence[tuple[float, float]]) -> Outline:
    """A shape without symmetry, turned counter-clockwise and centred between its extremes."""
    outline = np.array(corners, dtype=np.float64)
    outline = outline if area(outline) > 0 else outline[::-1].copy()
    return Outline(name, outline - (outline.min(axis=0) + outline.max(axis=0)) / 2, 1)


_LETTER_R = (
    (-8, -10),
    (-2, -10),
    (-2, -3),
    (3, -10),
    (9, -10),
    (3.5, -2),
    (7, 1),
    (8, 4.5),
    (6.5, 8.5),
    (3, 10),
    (-8, 10),
)
_LETTER_A = ((-10, -10), (-4.5, -10), (-3.2, -5.5), (3.2, -5.5), (4.5, -10), (10, -10), (3.2, 10), (-3.2, 10))
_LETTER_T = ((-3.2, -10), (3.2, -10), (3.2, 4), (10, 4), (10, 10), (-10, 10), (-10, 4), (-3.2, 4))
_LETTER_G = (
    (10, 5.5),
    (5.5, 10),
    (-4, 10),
    (-10, 5),
    (-10, -5),
    (-4, -10),
    (10, -10),
    (10, 0.5),
    (2.5, 0.5),
    (2.5, -4.5),
    (-1.5, -4.5),
    (-4.5, -2),
    (-4.5, 2),
    (-1.5, 4.5),
    (4, 4.5),
    (6.5, 2.5),
)
_LETTER_V = ((-3.4, -10), (3.4, -10), (10.5, 10), (4.2, 10), (0, -2.5), (-4.2, 10), (-10.5, 10))
_LETTER_E = (
    (-8, -10),
    (8, -10),
    (8, -5.2),
    (-2, -5.2),
    (-2, -2.4),
    (6, -2.4),
    (6, 2.4),
    (-2, 2.4),
    (-2, 5.2),
    (8, 5.2),
    (8, 10),
    (-8, 10),
)
_LETTER_L = ((-8, -10), (8, -10), (8, -4), (-2, -4), (-2, 10), (-8, 10))
_LETTER_M = (
    (-11, -8.5),
    (-5.5, -8.5),
    (-5.5, 0),
    (0, -6),
    (5.5, 0),
    (5.5, -8.5),
    (11, -8.5),
    (11, 8.5),
    (6, 8.5),
    (0, 2),
    (-6, 8.5),
    (-11, 8.5),
)
