"""Proxies fitted to points: box, cylinder, bowl, open box or convex hull, with the photo as their texture."""

import math
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
import numpy.typing as npt

from grs_agents.base import Vec3
from grs_agents.files import write_bytes, write_text
from grs_agents.library.asset import Asset
from grs_agents.library.color import color_name
from grs_agents.library.proxy import check_proxy, list_proxy
from grs_agents.library.proxy_mesh import Faceted, box_mesh, hull_mesh, joined, obj_text, support, turned_mesh
from grs_agents.library.shapes import Shape
from grs_agents.library.urdf_text import urdf_text

Floats = npt.NDArray[np.float64]
Fitted = Literal["box", "cylinder", "bowl", "open box", "hull"]
_DENSITY, _SHELL = 300.0, 0.35
_MASS_RANGE = (0.02, 2.0)
_WALL = 0.005
_SEGMENTS = 12
_OFF, _BETTER = 0.004, 0.6
"""Points that are more than this (m) off box and cylinder are given their hull, if that is so much nearer."""
_FEWEST = 50


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


def fitted_kind(points: Floats, size: Vec3, around: bool, hollow: bool) -> Fitted:
    """Which solid fits points best.

    Args:
        points: (N, 3) m, about the centre of the measured box, along its axes.
        size: of the measured box, m.
        around: its footprint is round.
        hollow: it is open at the top.
    """
    if hollow and min(size) > 4 * _WALL:
        return "bowl" if around else "open box"
    plain: Fitted = "cylinder" if around else "box"
    if len(points) < _FEWEST:
        return plain
    off = {"box": _box_off(points, size), "cylinder": _cylinder_off(points, size)}
    hull = np.abs(support(completed(points, size), points)).mean()
    return "hull" if off[plain] > _OFF and hull < _BETTER * off[plain] else plain


def completed(points: Floats, size: Vec3) -> Floats:
    """(M, 3) points with their unseen side, taken to be like the seen one turned round, in a box of ``size``."""
    half = np.asarray(size) / 2
    kept = np.clip(points, -half, half)
    whole = np.concatenate([kept, kept * (-1, -1, 1)])
    low = whole[whole[:, 2] < -0.2 * half[2]]
    foot = (low if len(low) else whole) * (1, 1, 0) - (0, 0, half[2])
    whole = np.concatenate([whole, foot])
    return whole * half / np.maximum(np.abs(whole).max(axis=0), 1e-9)


def write_fitted_proxy(
    root: Path,
    slug: str,
    kind: Fitted,
    points: Floats,
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
        points: (N, 3) m; needed for a hull.
        size: extents along x, y, z in m.
        color: red, green, blue in 0..1, where there is no look.
        description: one sentence.
        look: what the photo shows of it.

    Raises:
        InputError: the slug, size or colour is out of range, or the folder cannot be written.
    """
    check_proxy(slug, size, color)
    extents = (
        _round_size(size) if kind in ("cylinder", "bowl") else (round(size[0], 5), round(size[1], 5), round(size[2], 5))
    )
    hollow = kind in ("bowl", "open box")
    filling = {"cylinder": math.pi / 4, "hull": 0.7}.get(kind, 1.0) * (_SHELL if hollow else 1.0)
    mass = round(min(max(math.prod(extents) * filling * _DENSITY, _MASS_RANGE[0]), _MASS_RANGE[1]), 4)
    asset = Asset(
        name=f"proxy/{slug}.urdf", kind=slug, category="proxy", size=extents, mass=mass, friction=0.6,
        color=color_name(color), description=description, hollow=hollow,
    )  # fmt: skip
    mesh = _mesh(kind, extents, points)
    write_text(root / f"proxy/{slug}.obj", obj_text(mesh, None if look is None else _uvs(mesh, look)))
    red, green, blue = (round(float(channel), 3) for channel in color)
    texture = None if look is None else f"proxy/{slug}.png"
    seen = Shape(kind="mesh", size=(1.0, 1.0, 1.0), mesh=f"proxy/{slug}.obj", texture=texture,
                 color=(1.0, 1.0, 1.0, 1.0) if look is not None else (red, green, blue, 1.0))  # fmt: skip
    if look is not None:
        write_bytes(root / f"proxy/{slug}.png", _png(look.image))
    solids = _solids(kind, extents, root, slug)
    text = urdf_text(slug, [seen], solids, mass=mass, friction=0.6, inertia=_inertia(extents, mass),
                     folder="proxy")  # fmt: skip
    write_text(root / asset.name, text)
    list_proxy(root, asset)
    return asset


def _inertia(size: Vec3, mass: float) -> Vec3:
    """Principal moments (kg m^2) of a solid box."""
    x, y, z = (extent**2 * mass / 12 for extent in size)
    return (y + z, x + z, x + y)


def _mesh(kind: Fitted, size: Vec3, points: Floats) -> Faceted:
    radius, half = size[0] / 2, size[2] / 2
    if kind == "cylinder":
        return turned_mesh([(0, -half), (radius / 2, -half), (radius, -half), (radius, -half / 3), (radius, half / 3),
                            (radius, half), (radius / 2, half), (0, half)])  # fmt: skip
    if kind == "bowl":
        foot = _foot(size)
        return turned_mesh([(0, -half), (foot, -half), ((foot + radius) / 2, 0), (radius, half), (radius - _WALL, half),
                            (foot - _WALL, _WALL - half), (0, _WALL - half)])  # fmt: skip
    if kind == "open box":
        return joined([box_mesh(extents, center) for extents, center in _slabs(size)])
    if kind == "hull":
        vertices, faces = hull_mesh(completed(points, size))
        low, high = vertices.min(axis=0), vertices.max(axis=0)
        return (vertices - (low + high) / 2) * np.asarray(size) / np.maximum(high - low, 1e-9), faces
    return box_mesh(size)


def _solids(kind: Fitted, size: Vec3, root: Path, slug: str) -> list[Shape]:
    """What touches; the convex pieces of a bowl's wall are written beside its mesh."""
    if kind == "box":
        return [Shape(kind="box", size=size)]
    if kind == "cylinder":
        return [Shape(kind="cylinder", size=(size[0] / 2, size[2]))]
    if kind == "hull":
        return [Shape(kind="mesh", size=(1.0, 1.0, 1.0), mesh=f"proxy/{slug}.obj")]
    if kind == "open box":
        return [Shape(kind="box", size=extents, position=center) for extents, center in _slabs(size)]
    floor = Shape(kind="cylinder", size=(_foot(size), _WALL), position=(0.0, 0.0, (_WALL - size[2]) / 2))
    pieces: list[Shape] = []
    for number, corners in enumerate(_staves(size)):
        name = f"proxy/{slug}_wall{number:02d}.obj"
        write_text(root / name, obj_text(hull_mesh(corners)))
        pieces.append(Shape(kind="mesh", size=(1.0, 1.0, 1.0), mesh=name))
    return [floor, *pieces]


def _staves(size: Vec3) -> list[Floats]:
    """The corners (8, 3) of each piece of a bowl's wall."""
    half, foot, radius = size[2] / 2, _foot(size), size[0] / 2
    angles = np.arange(_SEGMENTS + 1) * 2 * np.pi / _SEGMENTS
    rings = [(foot, -half), (foot - _WALL, -half), (radius, half), (radius - _WALL, half)]
    return [
        np.array([[r * math.cos(angle), r * math.sin(angle), z] for r, z in rings for angle in angles[at : at + 2]])
        for at in range(_SEGMENTS)
    ]


def _slabs(size: Vec3) -> list[tuple[Vec3, Vec3]]:
    """Size and centre of the floor and the four walls of an open box."""
    x, y, z = size
    return [
        ((x, y, _WALL), (0.0, 0.0, (_WALL - z) / 2)),
        *(((_WALL, y, z), (side * (x - _WALL) / 2, 0.0, 0.0)) for side in (1, -1)),
        *(((x, _WALL, z), (0.0, side * (y - _WALL) / 2, 0.0)) for side in (1, -1)),
    ]


def _foot(size: Vec3) -> float:
    """The radius of a bowl's foot: what is flat has a small one, a mug is as wide below as above."""
    return size[0] / 2 * (0.65 if size[2] < 0.6 * size[0] else 1.0)


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


def _box_off(points: Floats, size: Vec3) -> float:
    beyond = np.abs(points) - np.asarray(size) / 2
    outside = np.linalg.norm(np.clip(beyond, 0, None), axis=1)
    return float(np.abs(outside + np.minimum(beyond.max(axis=1), 0)).mean())


def _cylinder_off(points: Floats, size: Vec3) -> float:
    radius = (size[0] + size[1]) / 4
    beyond = np.column_stack([np.hypot(points[:, 0], points[:, 1]) - radius, np.abs(points[:, 2]) - size[2] / 2])
    outside = np.linalg.norm(np.clip(beyond, 0, None), axis=1)
    return float(np.abs(outside + np.minimum(beyond.max(axis=1), 0)).mean())


def _round_size(size: Vec3) -> Vec3:
    diameter = round((size[0] + size[1]) / 2, 5)
    return (diameter, diameter, round(size[2], 5))


def _png(image: npt.NDArray[np.uint8]) -> bytes:
    import cv2

    return bytes(cv2.imencode(".png", np.ascontiguousarray(image[:, :, ::-1]))[1].tobytes())
