"""Writes proxies of real objects that no asset matches; they have the measured size and the photo as texture."""

import math
import re
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from grs_agents.base import Vec3
from grs_agents.errors import InputError
from grs_agents.files import write_bytes, write_json, write_text
from grs_agents.library import (
    MANIFEST,
    Asset,
    Manifest,
    Shape,
    box_inertia,
    color_name_from_rgb,
    encode_png,
    read_manifest,
)
from grs_agents.library.formats import format_urdf_text
from grs_agents.perception.proxies.height_blocks import Block, fit_height_blocks, stretch_blocks_to_size
from grs_agents.perception.proxies.meshes import (
    Faceted,
    box_mesh,
    hull_mesh,
    join_meshes,
    mesh_to_obj_text,
    revolved_mesh,
)
from grs_agents.perception.proxies.proxy_kind import (
    WALL,
    MeasuredShape,
    ProxyKind,
    add_unseen_side,
    bowl_foot_radius,
    bowl_profile,
    bowl_wall_pieces,
    open_box_walls,
    size_with_mean_diameter,
)

Floats = npt.NDArray[np.float64]
_MASS_RANGE = (0.02, 2.0)
_SIZE_RANGE = (0.001, 2.0)
_DENSITY, _SHELL = 300.0, 0.35
_FRICTION = 0.6


@dataclass(frozen=True)
class ProxyTexture:
    """What an object looks like in the photo."""

    # (H, W, 3) uint8 red, green, blue; what is not of the object is filled with what is beside it
    image: npt.NDArray[np.uint8]
    # points (N, 3) in the object's frame to texture coordinates (N, 2), origin lower left
    uv_of: Callable[[Floats], Floats]
    to_camera: Floats  # (3,) unit vector towards the camera, object's frame


def write_proxy(
    root: Path,
    slug: str,
    kind: ProxyKind,
    size: Vec3,
    color: Vec3,
    description: str,
    measured: MeasuredShape | None = None,
    texture: ProxyTexture | None = None,
) -> Asset:
    """Write ``root/proxy/<slug>.urdf`` with its meshes and texture, and its entry in ``root/manifest.json``.

    A cylinder and a bowl have the mean of the horizontal extents as their diameter; the mass is that of 300 kg/m^3,
    within 0.02 to 2 kg.

    Args:
        root: the library folder to write into; `Library.overlay` then knows ``"proxy/<slug>.urdf"``.
        slug: letters, digits, ``_`` and ``-``; a proxy of that name is replaced.
        size: extents along x, y, z in m.
        color: red, green, blue in 0..1, where there is no texture.
        measured: needed for hull and height blocks.

    Raises:
        InputError: the slug, size or colour is out of range, or the folder cannot be written.
    """
    _check_proxy_arguments(slug, size, color)
    x, y, z = (round(extent, 5) for extent in size)
    extents = size_with_mean_diameter(size) if kind in ("cylinder", "bowl") else (x, y, z)
    boxes = _build_proxy_boxes(kind, extents, size, measured)
    asset = Asset(
        name=f"proxy/{slug}.urdf",
        kind=slug,
        category="proxy",
        size=extents,
        mass=_estimate_mass(kind, extents, boxes),
        friction=_FRICTION,
        color=color_name_from_rgb(color),
        description=description,
        hollow=kind in ("bowl", "open box"),
    )
    mesh = _build_visible_mesh(kind, extents, measured, boxes)
    uvs = None if texture is None else _compute_vertex_uvs(mesh, texture)
    write_text(root / f"proxy/{slug}.obj", mesh_to_obj_text(mesh, uvs))
    red, green, blue = (1.0, 1.0, 1.0) if texture is not None else (round(float(channel), 3) for channel in color)
    update: dict[str, Any] = {"color": (red, green, blue, 1.0)}
    if texture is not None:
        update["texture"] = f"proxy/{slug}.png"
        write_bytes(root / update["texture"], encode_png(texture.image))
    seen = _shape_from_mesh_file(f"proxy/{slug}.obj").model_copy(update=update)
    solids, inertia = _build_collider_shapes(kind, extents, boxes, root, slug), box_inertia(extents, asset.mass)
    text = format_urdf_text(slug, [seen], solids, mass=asset.mass, friction=_FRICTION, inertia=inertia, folder="proxy")
    write_text(root / asset.name, text)
    others = tuple(old for old in read_manifest(root).assets if old.name != asset.name)
    write_json(root / MANIFEST, Manifest(assets=(*others, asset)).model_dump(mode="json"))
    return asset


def _check_proxy_arguments(slug: str, size: Vec3, color: Vec3) -> None:
    """Refuse what makes no proxy."""
    if not re.fullmatch(r"[A-Za-z0-9][A-Za-z0-9_-]{0,63}", slug):
        raise InputError(f"proxy name {slug!r}", "use letters, digits, '_' and '-', at most 64 of them")
    low, high = _SIZE_RANGE
    if not all(low <= extent <= high for extent in size):
        raise InputError(f"proxy {slug} has size {size} m", f"give extents between {low} and {high} m")
    if not all(0 <= channel <= 1 for channel in color):
        raise InputError(f"proxy {slug} has colour {color}", "give red, green, blue in 0..1")


def _build_proxy_boxes(kind: ProxyKind, extents: Vec3, size: Vec3, measured: MeasuredShape | None) -> list[Block]:
    """The boxes that a proxy consists of; none where it is no union of boxes."""
    if kind == "height blocks" and measured is not None and measured.fillable is not None:
        return stretch_blocks_to_size(fit_height_blocks(measured.fillable, size), extents)
    return {"box": [(extents, (0.0, 0.0, 0.0))], "open box": open_box_walls(extents)}.get(kind, [])


def _estimate_mass(kind: ProxyKind, size: Vec3, boxes: list[Block]) -> float:
    """Of what fills a share of its box, kg."""
    share = {"cylinder": math.pi / 4, "hull": 0.7, "bowl": _SHELL, "open box": _SHELL}.get(kind, 1.0)
    volume = sum(math.prod(extents) for extents, _ in boxes) if kind == "height blocks" else math.prod(size) * share
    return round(min(max(volume * _DENSITY, _MASS_RANGE[0]), _MASS_RANGE[1]), 4)


def _build_visible_mesh(kind: ProxyKind, size: Vec3, measured: MeasuredShape | None, boxes: list[Block]) -> Faceted:
    """What is seen of it."""
    if kind == "cylinder":
        radius, half = size[0] / 2, size[2] / 2
        rings = [(radius / 2, -half), (radius, -half), (radius, -half / 3)]  # not too long for a texture
        return revolved_mesh([(0, -half), *rings, *((across, -up) for across, up in reversed(rings)), (0, half)])
    if kind == "bowl":
        return revolved_mesh(bowl_profile(size))
    if kind == "hull" and measured is not None:
        vertices, faces = hull_mesh(add_unseen_side(measured.points, size))
        low, high = vertices.min(axis=0), vertices.max(axis=0)
        return (vertices - (low + high) / 2) * np.asarray(size) / np.maximum(high - low, 1e-9), faces
    return join_meshes([box_mesh(extents, center, 2 if kind == "height blocks" else 6) for extents, center in boxes])


def _shape_from_mesh_file(file: str) -> Shape:
    return Shape(kind="mesh", size=(1.0, 1.0, 1.0), mesh=file)


def _build_collider_shapes(kind: ProxyKind, size: Vec3, boxes: list[Block], root: Path, slug: str) -> list[Shape]:
    """What touches; the convex pieces of a bowl's wall are written beside its mesh."""
    if kind == "cylinder":
        return [Shape(kind="cylinder", size=(size[0] / 2, size[2]))]
    if kind == "hull":
        return [_shape_from_mesh_file(f"proxy/{slug}.obj")]
    if kind != "bowl":
        return [Shape(kind="box", size=extents, position=center) for extents, center in boxes]
    pieces = [Shape(kind="cylinder", size=(bowl_foot_radius(size), WALL), position=(0.0, 0.0, (WALL - size[2]) / 2))]
    for number, corners in enumerate(bowl_wall_pieces(size)):
        name = f"proxy/{slug}_wall{number:02d}.obj"
        write_text(root / name, mesh_to_obj_text(hull_mesh(corners)))
        pieces.append(_shape_from_mesh_file(name))
    return pieces


def _compute_vertex_uvs(mesh: Faceted, texture: ProxyTexture) -> Floats:
    """Texture coordinates of vertices; what the camera does not see looks like what is seen on the other side."""
    vertices, faces = mesh
    crosses = np.cross(vertices[faces[:, 1]] - vertices[faces[:, 0]], vertices[faces[:, 2]] - vertices[faces[:, 0]])
    normals = np.zeros_like(vertices)
    for corner in range(3):
        np.add.at(normals, faces[:, corner], crosses)
    hidden = normals @ texture.to_camera < 0
    places = np.where(hidden[:, None], vertices * (-1, -1, 1), vertices)
    return np.clip(texture.uv_of(places), 0, 1)
