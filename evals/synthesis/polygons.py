"""Plane polygons: their area, the triangles and the convex pieces that tile them."""

import numpy as np
import numpy.typing as npt

Floats = npt.NDArray[np.float64]
Corners = tuple[int, ...]


def area(outline: Floats) -> float:
    """The signed area (m^2) of a polygon (N, 2); positive if it runs counter-clockwise."""
    x, y = outline.T
    return float(np.sum(x * np.roll(y, -1) - np.roll(x, -1) * y) / 2)


def triangulate(outline: Floats) -> list[Corners]:
    """Triangles (counter-clockwise corner numbers) that tile a simple counter-clockwise polygon: ear clipping.

    Raises:
        ValueError: the polygon crosses itself or runs clockwise.
    """
    left, triangles = list(range(len(outline))), list[Corners]()
    while len(left) > 3:
        ears = [place for place in range(len(left)) if _is_ear(outline, left, place)]
        if not ears:
            raise ValueError(f"polygon of {len(outline)} corners crosses itself or runs clockwise")
        best = max(ears, key=lambda place: _fatness(outline[list(_three(left, place))]))
        triangles.append(_three(left, best))
        del left[best]
    return [*triangles, (left[0], left[1], left[2])]


def convex_pieces(outline: Floats) -> list[Floats]:
    """Convex polygons that tile a simple counter-clockwise polygon (N, 2).

    Triangles are joined across their longest common sides for as long as the joint piece is convex.
    """
    pieces = triangulate(outline)
    merged = True
    while merged:
        merged = False
        joints: list[tuple[float, Corners, Corners, Corners]] = []
        sides = {(piece[at - 1], piece[at]): (piece, at) for piece in pieces for at in range(len(piece))}
        for (start, end), (first, at) in sides.items():
            if start < end and (end, start) in sides:
                second, place = sides[end, start]
                joint = (*first[at:], *first[:at], *(*second[place:], *second[:place])[1:-1])
                joints.append((-float(np.linalg.norm(outline[end] - outline[start])), first, second, joint))
        for first, second, joint in [joint[1:] for joint in sorted(joints)]:
            corners = outline[list(joint)]
            count = len(corners)
            turns = [_turn(corners[i - 2], corners[i - 1], corners[i]) for i in range(count)]
            if min(turns) >= -1e-12:
                pieces = [piece for piece in pieces if piece not in (first, second)] + [joint]
                merged = True
                break
    return [outline[list(piece)] for piece in pieces]


def _three(left: list[int], place: int) -> Corners:
    return left[place - 1], left[place], left[(place + 1) % len(left)]


def _turn(a: Floats, b: Floats, c: Floats) -> float:
    return float((b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]))


def _is_ear(outline: Floats, left: list[int], place: int) -> bool:
    corners = _three(left, place)
    a, b, c = outline[list(corners)]
    if _turn(a, b, c) <= 1e-12:
        return False
    others = [outline[corner] for corner in left if corner not in corners]
    return not any(min(_turn(a, b, p), _turn(b, c, p), _turn(c, a, p)) >= -1e-12 for p in others)


def _fatness(corners: Floats) -> float:
    sides = np.linalg.norm(np.roll(corners, -1, axis=0) - corners, axis=1)
    return area(corners) / float(sides.max()) ** 2
