"""Proxies of real objects that no asset matches: box, cylinder, bowl, open box, hull or relief, fitted to points.

The photo is their texture. Where there are no points, a box or cylinder has the measured size.
"""

import math
import re
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
import numpy.typing as npt

from grs_agents.base import Vec3
from grs_agents.errors import InputError
from grs_agents.files import write_bytes, write_json, write_text
from grs_agents.library.asset import MANIFEST, Asset, Manifest, read_manifest
from grs_agents.library.colors import color_name
from grs_agents.library.formats.urdf import urdf_text
from grs_agents.library.mesh_files import box_inertia, png_bytes
from grs_agents.library.shapes import Shape
from grs_agents.perception.proxies.height_blocks import Block, stretched, whole_relief
from grs_agents.perception.proxies.kind import (
    WALL,
    Fitted,
    Measured,
    bowl_profile,
    completed,
    foot_radius,
    round_size,
    slabs,
    staves,
)
from grs_agents.perception.proxies.meshes import Faceted, box_mesh, hull_mesh, joined, obj_text, turned_mesh

Solid = Literal["box", "cylinder"]
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
        mass=_primitive_mass(shape, size),
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


def _primitive_mass(shape: Solid, size: Vec3) -> float:
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
        inertia=_primitive_inertia(shape, asset.size, asset.mass),
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


def _primitive_inertia(shape: Solid, size: Vec3, mass: float) -> Vec3:
    if shape == "cylinder":
        x, _, z = size
        across = mass * (3 * (x / 2) ** 2 + z**2) / 12
        return (across, across, mass * (x / 2) ** 2 / 2)
    return box_inertia(size, mass)


Floats = npt.NDArray[np.float64]
_DENSITY, _SHELL = 300.0, 0.35


@dataclass(frozen=True)
class Look:
    """What an object looks like in the photo.

    Attributes:
        image: (H, W, 3) uint8 red, green, blue; what is not of the object is filled with what is beside it.
        place: points (N, 3) in the object's frame to texture coordinates (N, 2), origin lower left.
        towards: (3,) unit vector towards the camera, object's frame.
    """

    image: npt.NDArray[np.uint8]
    place: Callable[[Floats], Floats]
    towards: Floats


def write_fitted_proxy(
    root: Path,
    slug: str,
    kind: Fitted,
    measured: Measured,
    size: Vec3,
    color: Vec3,
    description: str,
    look: Look | None = None,
) -> Asset:
    """Write ``root/proxy/<slug>.urdf`` with its meshes and texture, and its entry in ``root/manifest.json``.

    Args:
        root: the library folder to write into.
        slug: letters, digits, ``_`` and ``-``.
        kind: as `fitted_kind` found.
        measured: needed for hull and relief.
        size: extents along x, y, z in m.
        color: red, green, blue in 0..1, where there is no look.
        description: one sentence.
        look: what the photo shows of it.

    Raises:
        InputError: the slug, size or colour is out of range, or the folder cannot be written.
    """
    check_proxy(slug, size, color)
    x, y, z = (round(extent, 5) for extent in size)
    extents = round_size(size) if kind in ("cylinder", "bowl") else (x, y, z)
    hollow = kind in ("bowl", "open box")
    fill = measured.fill if kind == "relief" else None
    blocks = [] if fill is None else stretched(whole_relief(fill, size), extents)
    mass = _mass(kind, extents, blocks)
    asset = Asset(
        name=f"proxy/{slug}.urdf", kind=slug, category="proxy", size=extents, mass=mass, friction=0.6,
        color=color_name(color), description=description, hollow=hollow,
    )  # fmt: skip
    mesh = _mesh(kind, extents, measured.points, blocks)
    write_text(root / f"proxy/{slug}.obj", obj_text(mesh, None if look is None else _uvs(mesh, look)))
    red, green, blue = (round(float(channel), 3) for channel in color)
    texture = None if look is None else f"proxy/{slug}.png"
    seen = Shape(kind="mesh", size=(1.0, 1.0, 1.0), mesh=f"proxy/{slug}.obj", texture=texture,
                 color=(1.0, 1.0, 1.0, 1.0) if look is not None else (red, green, blue, 1.0))  # fmt: skip
    if look is not None:
        write_bytes(root / f"proxy/{slug}.png", png_bytes(look.image))
    solids = _solids(kind, extents, root, slug, blocks)
    text = urdf_text(slug, [seen], solids, mass=mass, friction=0.6, inertia=box_inertia(extents, mass),
                     folder="proxy")  # fmt: skip
    write_text(root / asset.name, text)
    list_proxy(root, asset)
    return asset


def _mass(kind: Fitted, size: Vec3, blocks: list[Block]) -> float:
    """Of what fills a share of its box, kg."""
    share = {"cylinder": math.pi / 4, "hull": 0.7, "bowl": _SHELL, "open box": _SHELL}.get(kind, 1.0)
    volume = sum(math.prod(extents) for extents, _ in blocks) or math.prod(size) * share
    return round(min(max(volume * _DENSITY, _MASS_RANGE[0]), _MASS_RANGE[1]), 4)


def _mesh(kind: Fitted, size: Vec3, points: Floats, blocks: list[Block]) -> Faceted:
    radius, half = size[0] / 2, size[2] / 2
    if kind == "cylinder":
        return turned_mesh([(0, -half), (radius / 2, -half), (radius, -half), (radius, -half / 3), (radius, half / 3),
                            (radius, half), (radius / 2, half), (0, half)])  # fmt: skip
    if kind == "bowl":
        return turned_mesh(bowl_profile(size))
    if kind == "open box":
        return joined([box_mesh(extents, center) for extents, center in slabs(size)])
    if kind == "hull":
        vertices, faces = hull_mesh(completed(points, size))
        low, high = vertices.min(axis=0), vertices.max(axis=0)
        return (vertices - (low + high) / 2) * np.asarray(size) / np.maximum(high - low, 1e-9), faces
    if kind == "relief":
        return joined([box_mesh(extents, center, grid=2) for extents, center in blocks])
    return box_mesh(size)


def _solids(kind: Fitted, size: Vec3, root: Path, slug: str, blocks: list[Block]) -> list[Shape]:
    """What touches; the convex pieces of a bowl's wall are written beside its mesh."""
    if kind == "box":
        return [Shape(kind="box", size=size)]
    if kind == "cylinder":
        return [Shape(kind="cylinder", size=(size[0] / 2, size[2]))]
    if kind == "hull":
        return [Shape(kind="mesh", size=(1.0, 1.0, 1.0), mesh=f"proxy/{slug}.obj")]
    if kind in ("open box", "relief"):
        parts = slabs(size) if kind == "open box" else blocks
        return [Shape(kind="box", size=extents, position=center) for extents, center in parts]
    floor = Shape(kind="cylinder", size=(foot_radius(size), WALL), position=(0.0, 0.0, (WALL - size[2]) / 2))
    pieces: list[Shape] = []
    for number, corners in enumerate(staves(size)):
        name = f"proxy/{slug}_wall{number:02d}.obj"
        write_text(root / name, obj_text(hull_mesh(corners)))
        pieces.append(Shape(kind="mesh", size=(1.0, 1.0, 1.0), mesh=name))
    return [floor, *pieces]


def _uvs(mesh: Faceted, look: Look) -> Floats:
    """Texture coordinates of vertices; what the camera does not see looks like what is seen on the other side."""
    vertices, faces = mesh
    crosses = np.cross(vertices[faces[:, 1]] - vertices[faces[:, 0]], vertices[faces[:, 2]] - vertices[faces[:, 0]])
    normals = np.zeros_like(vertices)
    for corner in range(3):
        np.add.at(normals, faces[:, corner], crosses)
    hidden = normals @ look.towards < 0
    places = np.where(hidden[:, None], vertices * (-1, -1, 1), vertices)
    return np.clip(look.place(places), 0, 1)
