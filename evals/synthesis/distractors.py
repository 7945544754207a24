"""Distractors: objects of random shape, size and colour that the library lacks, and a matcher must leave unmatched."""

import colorsys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import combinations, pairwise

import numpy as np
import numpy.typing as npt

from evals.synthesis.built_asset import BuiltAsset, build_asset
from evals.synthesis.colliders import box
from evals.synthesis.meshes import Mesh, annulus, loft, prism, superellipse, wedges
from evals.synthesis.polygons import convex_pieces
from grs_agents.base import Vec3
from grs_agents.library.asset import Asset
from grs_agents.library.shapes import Rgba, Shape, quaternion_from_rpy

Floats = npt.NDArray[np.float64]
FOLDER = "distractor"
_DENSITY = 400.0
_ROUND = 32
_HERE: Vec3 = (0.0, 0.0, 0.0)


@dataclass(frozen=True)
class ShapeDraft:
    """A shape before it is an asset: visuals and colliders (primitives or convex meshes), around its centre."""

    seen: Sequence[Shape | Mesh]
    solid: Sequence[Shape | Mesh]
    size: Vec3
    filling: float


def build_distractors(count: int, rng: np.random.Generator) -> list[BuiltAsset]:
    """``count`` random objects, named ``"distractor/<kind>_<number>.urdf"``."""
    return [_build(number, rng) for number in range(count)]


def _build(number: int, rng: np.random.Generator) -> BuiltAsset:
    kind = str(rng.choice(sorted(_KINDS)))
    draft = _KINDS[kind](rng)
    saturation, value = float(rng.choice([0.05, rng.uniform(0.3, 0.9)], p=[0.3, 0.7])), float(rng.uniform(0.06, 0.95))
    color = (*colorsys.hsv_to_rgb(float(rng.random()), saturation, value), 1.0)
    stem = f"{kind}_{number}"
    meshes: dict[str, str] = {}

    def shape_of(part: Shape | Mesh, name: str, tint: Rgba | None) -> Shape:
        if isinstance(part, Shape):
            return part.model_copy(update={"color": tint})
        file = f"{FOLDER}/{stem}_{name}.obj"
        meshes[file] = part.obj()
        return Shape(kind="mesh", size=(1.0, 1.0, 1.0), position=_HERE, color=tint, mesh=file)

    visuals = [shape_of(part, f"seen{index}", color) for index, part in enumerate(draft.seen)]
    colliders = [shape_of(part, f"solid{index}", None) for index, part in enumerate(draft.solid)]
    mass = float(np.clip(_DENSITY * draft.filling * np.prod(draft.size), 0.03, 1.0))
    asset = Asset(
        name=f"{FOLDER}/{stem}.urdf",
        kind=kind,
        category=kind,
        size=draft.size,
        mass=mass,
        friction=0.6,
        color="unknown",
        description=f"a {kind} that the library does not hold",
    )
    return build_asset(asset, visuals, colliders, meshes)


def _vase(rng: np.random.Generator) -> ShapeDraft:
    """A turned solid with a random profile."""
    height, heights = float(rng.uniform(0.06, 0.17)), np.linspace(0, 1, 7)
    radii = np.interp(heights, np.linspace(0, 1, 4), rng.uniform(0.018, 0.045, 4))
    rings = [(r, r, (h - 0.5) * height) for r, h in zip(radii.tolist(), heights.tolist(), strict=True)]
    circle = superellipse(count=_ROUND)
    mesh = loft(circle, rings)
    return ShapeDraft([mesh], [loft(circle, pair) for pair in pairwise(rings)], _extents(mesh), 0.6)


def _cone(rng: np.random.Generator) -> ShapeDraft:
    radius, height = float(rng.uniform(0.025, 0.05)), float(rng.uniform(0.05, 0.14))
    mesh = loft(superellipse(count=_ROUND), [(radius, radius, 0.0), (0.2 * radius, 0.2 * radius, height)]).centred()
    return ShapeDraft([mesh], [mesh], _extents(mesh), 0.35)


def _pebble(rng: np.random.Generator) -> ShapeDraft:
    """The convex hull of points on an ellipsoid: triangles whose plane has all other points on the same side."""
    points = rng.normal(size=(24, 3))
    points *= rng.uniform(0.02, 0.05, 3) / np.linalg.norm(points, axis=1, keepdims=True)
    faces = np.array(list(combinations(range(len(points)), 3)))
    a, b, c = (points[faces[:, corner]] for corner in range(3))
    normals = np.cross(b - a, c - a)
    heights = normals @ points.T - (normals * a).sum(axis=1, keepdims=True)
    out, back = (heights < 1e-12).all(axis=1), (heights > -1e-12).all(axis=1)
    faces = np.vstack([faces[out], faces[back][:, ::-1]])
    mesh = Mesh(points, faces, np.zeros((1, 2)), np.zeros_like(faces)).centred()
    return ShapeDraft([mesh], [mesh], _extents(mesh), 0.5)


def _cookie_cutter(rng: np.random.Generator) -> ShapeDraft:
    """A thick star or cross, not convex."""
    corners = int(rng.integers(4, 7))
    angles = np.arange(2 * corners) * np.pi / corners
    reach = np.where(np.arange(2 * corners) % 2, rng.uniform(0.45, 0.7), 1.0) * rng.uniform(0.035, 0.06)
    flat, half = np.stack([np.cos(angles), np.sin(angles)], 1) * reach[:, None], float(rng.uniform(0.008, 0.025))
    mesh = prism(flat, -half, half)
    return ShapeDraft([mesh], [prism(piece, -half, half) for piece in convex_pieces(flat)], _extents(mesh), 0.5)


def _ring(rng: np.random.Generator) -> ShapeDraft:
    """A roll of tape: a hole goes through it."""
    outer, half = float(rng.uniform(0.03, 0.055)), float(rng.uniform(0.01, 0.03))
    inner, circle = outer * float(rng.uniform(0.55, 0.8)), superellipse(count=_ROUND)
    mesh = annulus(circle * outer, circle * inner, -half, half)
    pieces = [prism(piece, -half, half) for piece in wedges(circle * outer, circle * inner, 4)]
    return ShapeDraft([mesh], pieces, _extents(mesh), 0.4)


def _ball(rng: np.random.Generator) -> ShapeDraft:
    radius = float(rng.uniform(0.02, 0.04))
    solid = Shape(kind="sphere", size=(radius,))
    return ShapeDraft([solid], [solid], (2 * radius, 2 * radius, 2 * radius), 0.5)


def _pen(rng: np.random.Generator) -> ShapeDraft:
    """Long and thin, as pens and cutlery."""
    length, radius = float(rng.uniform(0.12, 0.18)), float(rng.uniform(0.004, 0.008))
    solid = Shape(kind="cylinder", size=(radius, length), quaternion=quaternion_from_rpy(0.0, np.pi / 2, 0.0))
    return ShapeDraft([solid], [solid], (length, 2 * radius, 2 * radius), 0.8)


def _book(rng: np.random.Generator) -> ShapeDraft:
    size = (float(rng.uniform(0.12, 0.2)), float(rng.uniform(0.09, 0.14)), float(rng.uniform(0.013, 0.035)))
    solid = box(size)
    return ShapeDraft([solid], [solid], size, 1.0)


def _bracket(rng: np.random.Generator) -> ShapeDraft:
    """Two boxes at a right angle."""
    long, wide, tall = (float(value) for value in rng.uniform((0.06, 0.03, 0.05), (0.12, 0.05, 0.1)))
    thick = float(rng.uniform(0.012, 0.025))
    parts = [
        box((long, wide, thick), (0.0, 0.0, (thick - tall) / 2)),
        box((thick, wide, tall), ((thick - long) / 2, 0.0, 0.0)),
    ]
    return ShapeDraft(parts, parts, (long, wide, tall), 0.4)


def _extents(mesh: Mesh) -> Vec3:
    x, y, z = (float(value) for value in np.ptp(mesh.vertices, axis=0))
    return (x, y, z)


_KINDS: dict[str, Callable[[np.random.Generator], ShapeDraft]] = {
    "ball": _ball,
    "book": _book,
    "bracket": _bracket,
    "cone": _cone,
    "cookie_cutter": _cookie_cutter,
    "pebble": _pebble,
    "pen": _pen,
    "ring": _ring,
    "vase": _vase,
}
