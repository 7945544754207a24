"""Low-poly closed meshes with texture coordinates, made by stacking cross-sections.

Upright solids over plane outlines, as meshes without texture.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import trimesh

from evals.synthesis.polygons import triangulate
from grs_agents.base import Vec3

Floats = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int64]

STRIP = 0.75
"""The part of a texture's height, from its top, that wraps around the side; the caps lie below it."""


@dataclass(frozen=True)
class Mesh:
    """Triangles with texture coordinates for each corner.

    Attributes:
        vertices: (N, 3) m.
        faces: (F, 3) vertex indices, counter-clockwise seen from outside.
        uvs: (M, 2) texture coordinates, origin at the image's lower left.
        face_uvs: (F, 3) indices into ``uvs``.
    """

    vertices: Floats
    faces: Ints
    uvs: Floats
    face_uvs: Ints

    def centred(self) -> "Mesh":
        """The same mesh with the centre of its axis-aligned box at the origin."""
        middle = (self.vertices.min(axis=0) + self.vertices.max(axis=0)) / 2
        return Mesh(self.vertices - middle, self.faces, self.uvs, self.face_uvs)

    def moved(self, offset: Vec3) -> "Mesh":
        """The same mesh moved by ``offset`` m."""
        return Mesh(self.vertices + np.asarray(offset), self.faces, self.uvs, self.face_uvs)

    def solid(self) -> trimesh.Trimesh:
        """The mesh as trimesh sees it, for volume and inertia."""
        return trimesh.Trimesh(self.vertices, self.faces, process=False)

    def inertia(self, mass: float) -> Vec3:
        """Principal moments (kg m^2) about the axes of the frame, for a uniform solid of ``mass`` kg."""
        solid = self.solid()
        moments = np.diag(solid.moment_inertia) * mass / solid.volume
        return (float(moments[0]), float(moments[1]), float(moments[2]))

    def obj(self) -> str:
        """The mesh as Wavefront OBJ."""
        lines = [f"v {x:.6f} {y:.6f} {z:.6f}" for x, y, z in self.vertices + 0.0]
        lines += [f"vt {u:.5f} {v:.5f}" for u, v in self.uvs]
        for corners, coordinates in zip(self.faces + 1, self.face_uvs + 1, strict=True):
            lines.append("f " + " ".join(f"{a}/{b}" for a, b in zip(corners, coordinates, strict=True)))
        return "\n".join([*lines, ""])


def rectangle() -> Floats:
    """The square of half-width 1, from (+1, -1), counter-clockwise: (4, 2)."""
    return np.array([[1.0, -1.0], [1.0, 1.0], [-1.0, 1.0], [-1.0, -1.0]])


def superellipse(exponent: float = 2.0, count: int = 32) -> Floats:
    """|x|^n + |y|^n = 1 from (0, -1), counter-clockwise: (count, 2). 2 is a circle; more is squarer."""
    angles = np.arange(count) * 2 * np.pi / count - np.pi / 2
    x, y = np.cos(angles), np.sin(angles)
    return np.stack([np.sign(x) * np.abs(x) ** (2 / exponent), np.sign(y) * np.abs(y) ** (2 / exponent)], 1)


def loft(outline: Floats, rings: Sequence[Vec3]) -> Mesh:
    """A closed solid through scaled copies of an outline.

    Args:
        outline: (N, 2) convex polygon, counter-clockwise.
        rings: (half width x, half width y, z) of each copy in m, in the order along the side.
    """
    sections = [np.column_stack([outline * (x, y), np.full(len(outline), z)]) for x, y, z in rings]
    widest = outline * np.max([ring[:2] for ring in rings], axis=0)
    lengths = np.linalg.norm(np.roll(widest, -1, axis=0) - widest, axis=1)
    total = np.cumsum(lengths)
    return skin(np.array(sections), np.concatenate([[0.0], total / total[-1]]))


def tube(path: Floats, radius: float, across: Vec3, count: int = 10) -> Mesh:
    """A closed tube around a plane path.

    Args:
        path: (M, 3) m.
        radius: m.
        across: unit normal of the plane the path lies in.
        count: corners of its cross-section.
    """
    tangents = np.gradient(path, axis=0)
    tangents /= np.linalg.norm(tangents, axis=1, keepdims=True)
    sides = np.cross(across, tangents)
    angles = np.arange(count) * 2 * np.pi / count
    circle = np.stack([np.cos(angles), np.sin(angles)], 1) * radius
    rings = [
        point + np.outer(circle[:, 0], side) + np.outer(circle[:, 1], across)
        for point, side in zip(path, sides, strict=True)
    ]
    return skin(np.array(rings), np.linspace(0, 1, count + 1))


def skin(sections: Floats, steps: Floats) -> Mesh:
    """Join sections (M, N, 3) by quads and close both ends by fans.

    Args:
        sections: corresponding closed polygons of N corners.
        steps: (N + 1,) horizontal texture coordinate of each corner, the first corner again at the end.
    """
    rows, count = sections.shape[:2]
    heights = sections[:, :, 2].mean(axis=1)
    span = float(np.ptp(heights)) or 1.0
    side_v = 1 - STRIP + STRIP * (heights - heights.min()) / span
    uvs = [np.column_stack([steps, np.full(count + 1, v)]) for v in side_v]
    faces: list[tuple[int, int, int]] = []
    face_uvs: list[tuple[int, int, int]] = []
    for row in range(rows - 1):
        for column in range(count):
            a, b = row * count + column, row * count + (column + 1) % count
            p, q = row * (count + 1) + column, row * (count + 1) + column + 1
            up, over = count, count + 1
            faces += [(a, b, b + up), (a, b + up, a + up)]
            face_uvs += [(p, q, q + over), (p, q + over, p + over)]
    first, corners = rows * count, rows * (count + 1)
    ends = np.stack([sections[0].mean(axis=0), sections[-1].mean(axis=0)])
    for end, (ring, offset) in enumerate(((0, 0.5), ((rows - 1) * count, 0.0))):
        base = corners + end * (count + 1)
        flat = sections[0 if end == 0 else -1][:, :2] - ends[end][:2]
        reach = np.maximum(np.abs(flat).max(axis=0), 1e-9)
        unit = (flat / reach) * (1, -1 if end == 0 else 1)
        uvs.append(_cap(np.vstack([unit, [[0.0, 0.0]]]), offset))
        for column in range(count):
            following = (column + 1) % count
            pair = (following, column) if end == 0 else (column, following)
            faces.append((ring + pair[0], ring + pair[1], first + end))
            face_uvs.append((base + pair[0], base + pair[1], base + count))
    vertices = np.vstack([sections.reshape(-1, 3), ends])
    return Mesh(vertices, np.array(faces), np.vstack(uvs), np.array(face_uvs))


def _cap(unit: Floats, offset: float) -> Floats:
    """Texture coordinates of points in [-1, 1]^2 on the cap whose rectangle starts at ``offset``.

    The top cap (offset 0) reads upright for somebody who stands on the +x side.
    """
    u = offset + 0.25 + 0.24 * unit[:, 1]
    v = (1 - STRIP) * (0.5 - 0.48 * unit[:, 0])
    return np.column_stack([u, v])


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
        inner: the inner edge, with as many corners.
        each: sides of the outer edge per piece; N is a multiple of it. The inner side of a piece is a single chord.
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
