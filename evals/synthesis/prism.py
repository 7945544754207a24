"""Upright solids over plane outlines, as meshes without texture."""

import numpy as np

from evals.synthesis.meshes import Floats, Ints, Mesh
from evals.synthesis.polygons import triangulate


def prism(outline: Floats, low: float, high: float) -> Mesh:
    """The closed solid over a simple counter-clockwise polygon (N, 2) from z = low to high."""
    count = len(outline)
    triangles = np.array(triangulate(outline), dtype=np.int64)
    around = np.arange(count)
    return _plain(
        np.vstack([np.column_stack([outline, np.full(count, z)]) for z in (low, high)]),
        np.vstack([triangles[:, ::-1], triangles + count, _side(around, around + count)]),
    )


def annulus(outer: Floats, inner: Floats, low: float, high: float) -> Mesh:
    """The closed solid between two counter-clockwise polygons (N, 2) of equally many corners."""
    count = len(outer)
    rings = [np.column_stack([outline, np.full(count, z)]) for outline, z in ((outer, low), (outer, high))]
    rings += [np.column_stack([outline, np.full(count, z)]) for outline, z in ((inner, high), (inner, low))]
    around = np.arange(count)
    faces = [_side(around + ring * count, around + (ring + 1) % 4 * count) for ring in range(4)]
    return _plain(np.vstack(rings), np.vstack(faces))


def wedges(outer: Floats, inner: Floats, each: int) -> list[Floats]:
    """Convex polygons that cover the ring between two counter-clockwise polygons (N, 2).

    Args:
        outer: the outer edge.
        inner: the inner edge, of as many corners.
        each: how many sides of the outer edge one piece has; N is a multiple of it. Its inner side is one chord.
    """
    starts = range(0, len(outer), each)
    closed = np.vstack([outer, outer[:1]]), np.vstack([inner, inner[:1]])
    return [np.vstack([closed[0][at : at + each + 1], closed[1][at + each], closed[1][at]]) for at in starts]


def _side(lower: Ints, upper: Ints) -> Ints:
    """Two triangles for each side of a closed wall between corresponding corners, seen from outside."""
    a, b, c, d = lower, np.roll(lower, -1), np.roll(upper, -1), upper
    return np.vstack([np.column_stack([a, b, c]), np.column_stack([a, c, d])])


def _plain(vertices: Floats, faces: Ints) -> Mesh:
    return Mesh(vertices, faces, np.zeros((1, 2)), np.zeros_like(faces))
