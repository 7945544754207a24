"""Primitive proxies: a real object that no asset matches becomes a box or cylinder of its measured size."""

import math
import re
from pathlib import Path
from typing import Literal

from grs_agents.base import Vec3
from grs_agents.errors import InputError
from grs_agents.files import write_json, write_text
from grs_agents.library.asset import MANIFEST, Asset, Manifest, read_manifest
from grs_agents.library.colors import color_name
from grs_agents.library.formats.urdf import urdf_text
from grs_agents.library.shapes import Shape

Solid = Literal["box", "cylinder"]
_DENSITY = 300.0
_MASS_RANGE = (0.02, 2.0)
_SIZE_RANGE = (0.001, 2.0)


def write_proxy(
    root: Path,
    slug: str,
    shape: Solid,
    size: Vec3,
    color: Vec3,
    description: str,
    *,
    category: str = "proxy",
    friction: float = 0.6,
) -> Asset:
    """Write ``root/proxy/<slug>.urdf`` and its entry in ``root/manifest.json``.

    Args:
        root: the library folder to write into; `Library.overlay` then knows ``"proxy/<slug>.urdf"``.
        slug: letters, digits, ``_`` and ``-``.
        shape: a cylinder stands on z and has the mean of the two horizontal extents as its diameter.
        size: extents along x, y, z in m.
        color: red, green, blue in 0..1.
        description: one sentence.
        category: what kind of thing it looks like.
        friction: sliding friction.

    Returns:
        The new asset; its mass is its volume times 300 kg/m^3, within 0.02 to 2 kg.

    Raises:
        InputError: the slug, size or colour is out of range, or the folder cannot be written.
    """
    check_proxy(slug, size, color)
    asset = Asset(
        name=f"proxy/{slug}.urdf",
        kind=slug,
        category=category,
        size=_solid_size(shape, size),
        mass=_mass(shape, size),
        friction=friction,
        color=color_name(color),
        description=description,
    )
    write_text(root / asset.name, _text(asset, shape, color))
    list_proxy(root, asset)
    return asset


def list_proxy(root: Path, asset: Asset) -> None:
    """Write an asset into ``root/manifest.json``, in place of one of its name.

    Raises:
        InputError: the folder cannot be written.
    """
    others = tuple(old for old in read_manifest(root).assets if old.name != asset.name)
    write_json(root / MANIFEST, Manifest(assets=(*others, asset)).model_dump(mode="json"))


def _solid_size(shape: Solid, size: Vec3) -> Vec3:
    x, y, z = (round(float(extent), 5) for extent in size)
    diameter = round((x + y) / 2, 5)
    return (x, y, z) if shape == "box" else (diameter, diameter, z)


def _mass(shape: Solid, size: Vec3) -> float:
    volume = math.prod(_solid_size(shape, size)) * (math.pi / 4 if shape == "cylinder" else 1.0)
    return round(min(max(volume * _DENSITY, _MASS_RANGE[0]), _MASS_RANGE[1]), 4)


def _text(asset: Asset, shape: Solid, color: Vec3) -> str:
    red, green, blue = (round(float(channel), 3) for channel in color)
    extents = asset.size if shape == "box" else (asset.size[0] / 2, asset.size[2])
    solid = Shape(kind=shape, size=extents, color=(red, green, blue, 1.0))
    return urdf_text(
        asset.kind,
        [solid],
        [solid],
        mass=asset.mass,
        friction=asset.friction,
        inertia=_inertia(shape, asset.size, asset.mass),
        folder="proxy",
    )


def check_proxy(slug: str, size: Vec3, color: Vec3) -> None:
    """Refuse what makes no proxy.

    Raises:
        InputError: the slug, size or colour is out of range.
    """
    if not re.fullmatch(r"[A-Za-z0-9][A-Za-z0-9_-]{0,63}", slug):
        raise InputError(f"proxy name {slug!r}", "use letters, digits, '_' and '-', at most 64 of them")
    low, high = _SIZE_RANGE
    if not all(low <= extent <= high for extent in size):
        raise InputError(f"proxy {slug} has size {size} m", f"give extents between {low} and {high} m")
    if not all(0 <= channel <= 1 for channel in color):
        raise InputError(f"proxy {slug} has colour {color}", "give red, green, blue in 0..1")


def _inertia(shape: Solid, size: Vec3, mass: float) -> Vec3:
    x, y, z = size
    if shape == "cylinder":
        across = mass * (3 * (x / 2) ** 2 + z**2) / 12
        return (across, across, mass * (x / 2) ** 2 / 2)
    return (mass * (y * y + z * z) / 12, mass * (x * x + z * z) / 12, mass * (x * x + y * y) / 12)
