"""Writes what stands for real objects that no asset matches: a textured mesh with colliders, in the run's library."""

import re
from pathlib import Path

import numpy as np

from grs_agents.base import Vec3
from grs_agents.base.errors import InputError
from grs_agents.base.files import write_bytes, write_json, write_text
from grs_agents.base.geometry.transforms import to_vec3
from grs_agents.library.asset import MANIFEST, Asset, Manifest, read_manifest
from grs_agents.library.colors import color_name_from_rgb
from grs_agents.library.formats.urdf import format_urdf_text
from grs_agents.library.mesh_files import box_inertia, encode_png, mesh_volume
from grs_agents.library.shapes import Shape
from grs_agents.perception.proxies.meshes import hull_mesh, mesh_to_obj_text
from grs_agents.perception.proxies.primitive_proxy import Proxy
from grs_agents.perception.shapes.colliders import Collider
from grs_agents.perception.types import Array

_MASS_RANGE = (0.02, 2.0)
_SIZE_RANGE = (0.001, 2.0)
_DENSITY, _WALL_DENSITY = 300.0, 1200.0  # kg/m^3: of packed goods, full or half empty; of plastic and ceramics
_FRICTION = 0.6


def write_proxy(root: Path, slug: str, proxy: Proxy, description: str) -> Asset:
    """Write ``root/proxy/<slug>.urdf`` with its mesh, texture and colliders, and its entry in ``root/manifest.json``.

    The asset's frame is the object's, moved to the centre of its colliders (`Proxy.center`). The mass is that of 300
    kg/m^3, of the walls of what is hollow 1200 kg/m^3, within 0.02 to 2 kg.

    Args:
        root: the library folder to write into; `Library.overlay` then knows ``"proxy/<slug>.urdf"``.
        slug: letters, digits, ``_`` and ``-``; a proxy of that name is replaced.

    Raises:
        InputError: the slug, size or colour is out of range, or the folder cannot be written.
    """
    low, high = proxy.bounds
    center, size = np.array(proxy.center), to_vec3((high - low).round(5))
    _require_valid_proxy(slug, size, proxy.color)
    volume = abs(mesh_volume(proxy.mesh.vertices, proxy.mesh.faces))
    mass = round(float(np.clip(volume * (_WALL_DENSITY if proxy.hollow else _DENSITY), *_MASS_RANGE)), 4)
    asset = Asset(
        name=f"proxy/{slug}.urdf",
        kind=slug,
        category="proxy",
        size=size,
        mass=mass,
        friction=_FRICTION,
        color=color_name_from_rgb(proxy.color),
        description=description,
        hollow=proxy.hollow,
    )
    mesh = proxy.mesh
    write_text(root / f"proxy/{slug}.obj", mesh_to_obj_text((mesh.vertices - center, mesh.faces), mesh.uvs))
    write_bytes(root / f"proxy/{slug}.png", encode_png(mesh.texture))
    seen = _make_mesh_shape(f"proxy/{slug}.obj").model_copy(
        update={"color": (1.0, 1.0, 1.0, 1.0), "texture": f"proxy/{slug}.png"}
    )
    solids = [
        _write_collider(root, f"proxy/{slug}_hull{number:02d}.obj", one, center)
        for number, one in enumerate(proxy.colliders)
    ]
    inertia = box_inertia(size, mass)
    text = format_urdf_text(slug, [seen], solids, mass=mass, friction=_FRICTION, inertia=inertia, folder="proxy")
    write_text(root / asset.name, text)
    others = tuple(old for old in read_manifest(root).assets if old.name != asset.name)
    write_json(root / MANIFEST, Manifest(assets=(*others, asset)).model_dump(mode="json"))
    return asset


def _require_valid_proxy(slug: str, size: Vec3, color: Vec3) -> None:
    """Refuse what makes no proxy."""
    if not re.fullmatch(r"[A-Za-z0-9][A-Za-z0-9_-]{0,63}", slug):
        raise InputError(f"proxy name {slug!r}", "use letters, digits, '_' and '-', at most 64 of them")
    low, high = _SIZE_RANGE
    if not all(low <= extent <= high for extent in size):
        raise InputError(f"proxy {slug} has size {size} m", f"give extents between {low} and {high} m")
    if not all(0 <= channel <= 1 for channel in color):
        raise InputError(f"proxy {slug} has colour {color}", "give red, green, blue in 0..1")


def _make_mesh_shape(file: str) -> Shape:
    return Shape(kind="mesh", size=(1.0, 1.0, 1.0), mesh=file)


def _write_collider(root: Path, name: str, collider: Collider, center: Array) -> Shape:
    """A collider about a centre; a hull is written to ``root/name``."""
    if isinstance(collider, Shape):
        return collider.model_copy(update={"position": to_vec3(collider.position - center)})
    write_text(root / name, mesh_to_obj_text(hull_mesh(collider.corners - center)))
    return _make_mesh_shape(name)
