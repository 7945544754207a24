"""Products that look like those of the library but are none of them: packages of other print, mugs of other size."""

import colorsys
from collections.abc import Mapping, Sequence

import numpy as np

from evals.synthesis.built_asset import BuiltAsset, build_asset
from evals.synthesis.label import Label, Motif
from evals.synthesis.mugs import mug_parts
from evals.synthesis.packages import FORMS, Package, build_package
from grs_agents.base import Vec3
from grs_agents.library.asset import Asset
from grs_agents.library.library import Library
from grs_agents.library.shapes import Rgba, Shape

FOLDER = "absent"
_WORDS = (
    *("OLIVES", "CHICK PEAS", "LENTILS", "COCOA", "GREEN TEA", "BROWN RICE", "ROLLED OATS", "HONEY", "SOY SAUCE"),
    *("VINEGAR", "CRACKERS", "WAFFLES", "CHILI", "SALSA", "PRUNES", "FLOUR", "GELATIN", "MUESLI", "CUSTARD"),
    *("TOMATO PASTE", "COFFEE", "SUGAR", "PEPPER", "SARDINES", "APRICOTS", "PLUM JAM", "GHEE"),
)
"""Of no product of the library."""
_MOTIFS: tuple[Motif, ...] = ("disc", "dots", "stripes", "waves", "leaves", "squares")
_SPANS: Mapping[str, tuple[tuple[float, float], float]] = {"can": ((0.03, 0.97), 1.0), "bottle": ((0.08, 0.6), 0.8)}
"""Where the label of a form lies, and from where on its side is the lid (fractions of the height)."""
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
    light = _brightness(base) > 0.55
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


def _brightness(color: str) -> float:
    """Of an ``rrggbb`` colour, 0..1 (Rec. 601 luma)."""
    return float(np.dot([int(text, 16) / 255 for text in _pairs(color)], (0.299, 0.587, 0.114)))
