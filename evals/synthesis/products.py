"""Products that look like those of the library but are none of them: packages of other print, mugs of other size."""

import colorsys
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from evals.synthesis.built_asset import BuiltAsset, build_asset
from evals.synthesis.colliders import box, cylinder, lifted, ring
from evals.synthesis.label import Label, Motif
from evals.synthesis.meshes import Mesh, loft, superellipse, tube
from evals.synthesis.packages import FORMS, Package, build_package
from grs_agents.base import Vec3
from grs_agents.library.asset import Asset
from grs_agents.library.library import Library
from grs_agents.library.shapes import Rgba, Shape

_MUG_WALL = 0.0035


@dataclass(frozen=True)
class MugParts:
    """The parts of a mug, around the centre of its box; its handle points to +x. Lengths in m."""

    body: Mesh
    handle: Mesh
    colliders: tuple[Shape, ...]
    size: Vec3


def mug_parts(radius: float, height: float, reach: float) -> MugParts:
    """A mug of this radius and height (m) whose handle reaches ``reach`` m beyond its wall."""
    profile = (
        (radius - 0.003, 0.0),
        (radius, 0.004),
        (radius, height),
        (radius - _MUG_WALL, height),
        (radius - _MUG_WALL, 0.006),
        (radius - 0.006, 0.005),
    )
    body = loft(superellipse(2.0, 32), [(r, r, z) for r, z in profile])
    middle, half = round(0.505 * height, 3), round(0.284 * height, 3)
    angles = np.linspace(-0.5 * math.pi, 0.5 * math.pi, 13)
    arc = np.stack([radius - 0.003 + (reach - 0.002) * np.cos(angles), 0 * angles, middle + half * np.sin(angles)], 1)
    handle = tube(arc, 0.005, (0.0, 1.0, 0.0))
    shift: Vec3 = (-reach / 2, 0.0, -height / 2)
    colliders = (
        cylinder(radius, 0.006, (0, 0, 0.003)),
        *ring(radius, 0.004, 0.006, height),
        box((0.010, 0.010, 2 * half), (radius + reach - 0.005, 0, middle)),
        *(
            box((reach - 0.008, 0.010, 0.010), (radius + reach / 2 - 0.005, 0, middle + side * (half - 0.001)))
            for side in (1, -1)
        ),
    )
    size = (2 * radius + reach, 2 * radius, height)
    return MugParts(body.moved(shift), handle.moved(shift), lifted(colliders, shift), size)


FOLDER = "absent"
_WORDS = (
    *("OLIVES", "CHICK PEAS", "LENTILS", "COCOA", "GREEN TEA", "BROWN RICE", "ROLLED OATS", "HONEY", "SOY SAUCE"),
    *("VINEGAR", "CRACKERS", "WAFFLES", "CHILI", "SALSA", "PRUNES", "FLOUR", "GELATIN", "MUESLI", "CUSTARD"),
    *("TOMATO PASTE", "COFFEE", "SUGAR", "PEPPER", "SARDINES", "APRICOTS", "PLUM JAM", "GHEE"),
)
"""Names of no product of the library."""
_MOTIFS: tuple[Motif, ...] = ("disc", "dots", "stripes", "waves", "leaves", "squares")
_SPANS: Mapping[str, tuple[tuple[float, float], float]] = {"can": ((0.03, 0.97), 1.0), "bottle": ((0.08, 0.6), 0.8)}
"""Vertical extent of a form's label, and lower edge of its lid (fractions of the height)."""
_DENSITY = 700.0


def build_products(count: int, library: Library, rng: np.random.Generator) -> list[BuiltAsset]:
    """``count`` random products; every form and the mug occur before any is repeated.

    Args:
        count: their number.
        library: of the products that they resemble in form and size.
        rng: source of everything random.
    """
    forms = [str(form) for _ in range(-(-count // (len(FORMS) + 1))) for form in rng.permutation([*FORMS, "mug"])]
    return [
        _mug(f"mug_{number}", rng) if form == "mug" else build_package(_package(f"{form}_{number}", form, library, rng))
        for number, form in enumerate(forms[:count])
    ]


def _package(kind: str, form: str, library: Library, rng: np.random.Generator) -> Package:
    """A package of the size of a library's, or somewhat larger or smaller."""
    sizes: Sequence[Vec3] = [asset.size for asset in library.everyday_assets() if asset.category == form]
    like, times = sizes[int(rng.integers(len(sizes)))], rng.uniform(0.8, 1.25, 3)
    scale = times if rng.random() < 0.5 else np.ones(3)
    if form not in ("box", "carton"):
        scale[1] = scale[0]
    x, y, z = (round(float(value), 4) for value in np.array(like) * scale)
    span, lid = _SPANS.get(form, ((0.0, 1.0), 1.0))
    base, band, spot, body, cap = (_print_color(rng) for _ in range(5))
    light = float(np.dot([int(text, 16) / 255 for text in _pairs(base)], (0.299, 0.587, 0.114))) > 0.55
    label = Label(
        lines=tuple(str(rng.choice(_WORDS)).split()),
        base=base,
        band=band,
        text="202020" if light else "f5f5f0",
        motif=_MOTIFS[int(rng.integers(len(_MOTIFS)))],
        spot=spot,
        body=body if form == "bottle" else "c8ccd0",
        cap=cap,
        span=span,
        lid=lid,
    )
    return Package(
        FOLDER, kind, form, (x, y, z), _DENSITY, "unknown", f"a {form} that the library does not hold", label
    )


def _mug(kind: str, rng: np.random.Generator) -> BuiltAsset:
    """A mug in a single colour, wider or narrower and higher or lower than the library's."""
    radius, height, reach = (float(value) for value in rng.uniform((0.032, 0.07, 0.024), (0.047, 0.115, 0.036)))
    parts = mug_parts(radius, height, reach)
    red, green, blue = (int(text, 16) / 255 for text in _pairs(_print_color(rng)))
    color: Rgba = (red, green, blue, 1.0)
    asset = Asset(
        name=f"{FOLDER}/{kind}.urdf",
        kind=kind,
        category="mug",
        size=parts.size,
        mass=0.3,
        friction=0.6,
        color="unknown",
        description="a mug that the library does not hold",
        hollow=True,
    )
    meshes = {f"{FOLDER}/{kind}_body.obj": parts.body.obj(), f"{FOLDER}/{kind}_handle.obj": parts.handle.obj()}
    visuals = [Shape(kind="mesh", size=(1, 1, 1), mesh=name, color=color) for name in meshes]
    return build_asset(asset, visuals, parts.colliders, meshes)


def _print_color(rng: np.random.Generator) -> str:
    """A printed colour, ``rrggbb``: mostly full, sometimes nearly white, grey or black."""
    saturation = rng.uniform(0.45, 0.95) if rng.random() < 0.75 else rng.uniform(0.0, 0.12)
    parts = colorsys.hsv_to_rgb(float(rng.random()), float(saturation), float(rng.uniform(0.25, 0.97)))
    return "".join(f"{round(255 * part):02x}" for part in parts)


def _pairs(color: str) -> tuple[str, str, str]:
    return color[:2], color[2:4], color[4:]
