"""Proxies: textured meshes with colliders, from a reconstructed shape or as primitives of the measured size.

`write_proxy` writes a proxy into the library of a run, `write_scaled_asset` a scaled copy of an asset.
"""

import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from grs_agents.base import Vec3
from grs_agents.base.errors import InputError
from grs_agents.base.files import write_bytes, write_json, write_text
from grs_agents.base.geometry.transforms import to_vec3
from grs_agents.library.asset import MANIFEST, Asset, AssetManifest, Quantity, read_manifest
from grs_agents.library.colors import color_name_from_rgb
from grs_agents.library.formats.urdf import format_urdf_text
from grs_agents.library.library import Library
from grs_agents.library.mesh_files import box_inertia, encode_png, mesh_volume
from grs_agents.library.shapes import Shape, shape_bounds
from grs_agents.perception.proxies.meshes import box_mesh, hull_mesh, join_meshes, mesh_to_obj_text, revolved_mesh
from grs_agents.perception.shapes.colliders import Collider, Hull, fit_colliders, open_box_colliders, ring_colliders
from grs_agents.perception.shapes.object_crop import crop_object
from grs_agents.perception.shapes.texture import paint_mesh
from grs_agents.perception.shapes.types import ObjectMesh, ObjectShape, ObjectView
from grs_agents.perception.types import Array, Solid

WALL = 0.005  # thickness of walls and floors of hollow primitives, m
_PLAIN = 4  # side of a plain texture, pixels
_MASS_RANGE = (0.02, 2.0)  # kg
_SIZE_RANGE = (0.001, 2.0)  # m
_DENSITY, _WALL_DENSITY = 300.0, 1200.0  # kg/m^3: of packed goods, full or half empty; of plastic and ceramics
_FRICTION = 0.6
_GIVEN_DEVIATION = 0.05  # of a mass or friction that a person gives, as a share: of a kitchen scale's reading and more


@dataclass(frozen=True)
class Proxy:
    """Stand-in for an object without an asset, in the object's frame: origin on the support."""

    mesh: ObjectMesh  # visual
    colliders: tuple[Collider, ...]
    hollow: bool  # open at the top
    color: Vec3  # mean red, green, blue in 0..1

    @classmethod
    def from_shape(cls, shape: ObjectShape, color: Vec3, solid: Solid, hollow: bool) -> "Proxy":
        """A reconstructed shape with fitted colliders; ``solid`` and ``hollow`` as in `fit_colliders`."""
        return cls(shape.mesh, fit_colliders(shape, solid, hollow), shape.hollow or hollow, color)

    @property
    def bounds(self) -> tuple[Array, Array]:
        """Lowest and highest corner (3,) of the colliders, m."""
        ends = [
            (collider.corners.min(axis=0), collider.corners.max(axis=0))
            if isinstance(collider, Hull)
            else shape_bounds(collider)
            for collider in self.colliders
        ]
        return np.min([low for low, _ in ends], axis=0), np.max([high for _, high in ends], axis=0)

    @property
    def center(self) -> Vec3:
        """Centre of the bounds, m."""
        low, high = self.bounds
        return to_vec3((low + high) / 2)


def primitive_proxy(
    solid: Solid, size: Vec3, color: Vec3, hollow: bool = False, view: ObjectView | None = None
) -> Proxy:
    """A box or a cylinder of a size (m), with walls and a floor if ``hollow``.

    Its texture is taken from a view, else plain (``color`` in 0..1). The diameter of a cylinder is the mean of its
    horizontal extents.
    """
    hollow = hollow and min(size) > 4 * WALL
    x, y, z = size
    if solid == "box":
        walls = (Shape(kind="box", size=size, position=(0.0, 0.0, z / 2)),)
        if hollow:
            walls = open_box_colliders(np.array((-x / 2, -y / 2, 0.0)), np.array((x / 2, y / 2, z)))
        colliders: tuple[Collider, ...] = walls
        faceted = join_meshes([box_mesh(to_vec3(wall.size), wall.position) for wall in walls])
    elif hollow:
        radius = (x + y) / 4
        inside = radius - WALL
        profile = [(0, 0), (radius, 0), (radius, z / 2), (radius, z), (inside, z), (inside, WALL), (0, WALL)]
        faceted = revolved_mesh(profile)
        rings = np.array([(inside, radius, WALL), (inside, radius, z)])
        colliders = ring_colliders(rings, np.zeros(2))
    else:
        radius = (x + y) / 4
        lower = [(radius / 2, 0.0), (radius, 0.0), (radius, z / 3)]  # short faces bend the texture less
        upper = [(across, z - up) for across, up in reversed(lower)]
        faceted = revolved_mesh([(0.0, 0.0), *lower, *upper, (0.0, z)])
        colliders = (Shape(kind="cylinder", size=(radius, z), position=(0.0, 0.0, z / 2)),)
    seen = None if view is None else crop_object(view)
    if seen is not None:
        return Proxy(paint_mesh(seen, *faceted), colliders, hollow, color)
    picture = np.full((_PLAIN, _PLAIN, 3), np.clip(np.multiply(color, 255).round(), 0, 255), np.uint8)
    return Proxy(ObjectMesh(*faceted, np.zeros((len(faceted[0]), 2)), picture), colliders, hollow, color)


def write_proxy(root: Path, slug: str, proxy: Proxy, description: str) -> Asset:
    """Write ``root/proxy/<slug>.urdf`` with its mesh, texture and colliders, and its entry in ``root/manifest.json``.

    The asset's frame is the object's, moved to the centre of its colliders (`Proxy.center`). The mass follows from the
    volume at 300 kg/m^3, for hollow proxies at 1200 kg/m^3, within 0.02 to 2 kg.

    Args:
        root: the library folder to write into; `Library.overlay` then knows ``"proxy/<slug>.urdf"``.
        slug: letters, digits, ``_`` and ``-``; a proxy of that name is replaced.
        proxy: the proxy.
        description: of the object, in words.

    Raises:
        InputError: the slug, size or colour is out of range, or the folder cannot be written.
    """
    low, high = proxy.bounds
    center, size = np.array(proxy.center), to_vec3((high - low).round(5))
    if not re.fullmatch(r"[A-Za-z0-9][A-Za-z0-9_-]{0,63}", slug):
        raise InputError(f"proxy name {slug!r}", "use letters, digits, '_' and '-', at most 64 of them")
    least, largest = _SIZE_RANGE
    if not all(least <= extent <= largest for extent in size):
        raise InputError(f"proxy {slug} has size {size} m", f"give extents between {least} and {largest} m")
    if not all(0 <= channel <= 1 for channel in proxy.color):
        raise InputError(f"proxy {slug} has colour {proxy.color}", "give red, green, blue in 0..1")
    mesh = proxy.mesh
    volume = abs(mesh_volume(mesh.vertices, mesh.faces))
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
    write_text(root / f"proxy/{slug}.obj", mesh_to_obj_text((mesh.vertices - center, mesh.faces), mesh.uvs))
    write_bytes(root / f"proxy/{slug}.png", encode_png(mesh.texture))
    visual = _make_mesh_shape(f"proxy/{slug}.obj").model_copy(
        update={"color": (1.0, 1.0, 1.0, 1.0), "texture": f"proxy/{slug}.png"}
    )
    colliders: list[Shape] = []
    for number, collider in enumerate(proxy.colliders):
        if isinstance(collider, Shape):
            colliders.append(collider.model_copy(update={"position": to_vec3(collider.position - center)}))
        else:
            name = f"proxy/{slug}_hull{number:02d}.obj"
            write_text(root / name, mesh_to_obj_text(hull_mesh(collider.corners - center)))
            colliders.append(_make_mesh_shape(name))
    inertia = box_inertia(size, mass)
    text = format_urdf_text(slug, [visual], colliders, mass=mass, friction=_FRICTION, inertia=inertia, folder="proxy")
    _write_urdf_and_entry(root, asset, text)
    return asset


def write_scaled_asset(root: Path, slug: str, name: str, library: Library, factor: float) -> Asset:
    """Write ``root/scaled/<slug>.urdf``, a uniformly scaled copy of an asset, and its entry in ``root/manifest.json``.

    It has copies of the asset's meshes and textures, and its kind, category and density.

    Args:
        root: the library folder to write into.
        slug: as in `write_proxy`.
        name: of the asset.
        library: of the asset.
        factor: the ratio of all lengths.

    Raises:
        InputError: a file of the asset is gone, or the folder cannot be written.
    """
    asset = library.asset(name)
    size, mass = to_vec3((factor * np.array(asset.size)).round(5)), round(asset.mass * factor**3, 4)
    scaled = asset.model_copy(
        update={
            "name": f"scaled/{slug}.urdf",
            "size": size,
            "mass": mass,
            "everyday": False,
            "physics": None,
            "fixture": False,
            "description": f"{asset.description} (its size times {factor:.2f})",
            "origin": None,
        }
    )
    _write_copy(root, scaled, name, library, factor)
    return scaled


def write_edited_asset(
    root: Path, slug: str, name: str, library: Library, mass: float | None = None, friction: float | None = None
) -> Asset:
    """Write a copy of an asset with a mass (kg) or friction that a person gave, and its entry in the manifest.

    It is ``root/<slug>/<stem>.urdf``, since words for an object follow from the stem of its asset; of a proxy
    ``root/proxy/<slug>.urdf``. Mass and friction count as measured. The other arguments and the errors are those of
    `write_scaled_asset`.
    """
    asset = library.asset(name)
    physics, update = asset.physics_or_defaults(), dict[str, Any]()
    for key, value in (("mass", mass), ("friction", friction)):
        if value is not None:
            update[key] = value
            measured = Quantity(value=value, provenance="measured", deviation=_GIVEN_DEVIATION)
            physics = physics.model_copy(update={key: measured})
    path = f"proxy/{slug}.urdf" if asset.category == "proxy" else f"{slug}/{Path(name).name}"
    update |= {"name": path, "everyday": False, "fixture": False, "physics": physics, "origin": None}
    edited = asset.model_copy(update=update)
    _write_copy(root, edited, name, library, 1.0)
    return edited


def _write_copy(root: Path, copy: Asset, name: str, library: Library, factor: float) -> None:
    """Write the URDF of a ``copy`` of the asset ``name``, with copies of its files, all lengths times ``factor``."""
    folder, slug = Path(copy.name).parent.name, Path(copy.name).stem
    model = library.load_object_model(name)
    copies: dict[str, str] = {}
    for shape in (*model.visuals, *model.colliders):
        for file in filter(None, (shape.mesh, shape.texture)):
            copies.setdefault(file, f"{folder}/{slug}_{len(copies):02d}{Path(file).suffix}")
    for file, target in copies.items():
        write_bytes(root / target, library.mesh_or_texture_path(file).read_bytes())

    def scale(shape: Shape) -> Shape:
        update: dict[str, Any] = {"size": tuple(factor * extent for extent in shape.size)}
        update |= {"position": to_vec3(factor * np.array(shape.position))}
        files = {"mesh": shape.mesh, "texture": shape.texture}
        return shape.model_copy(update=update | {key: copies[file] for key, file in files.items() if file})

    visuals, colliders = ([scale(shape) for shape in shapes] for shapes in (model.visuals, model.colliders))
    inertia = box_inertia(copy.size, copy.mass)
    text = format_urdf_text(
        slug, visuals, colliders, mass=copy.mass, friction=copy.friction, inertia=inertia, folder=folder
    )
    _write_urdf_and_entry(root, copy, text)


def _write_urdf_and_entry(root: Path, asset: Asset, text: str) -> None:
    """Write the URDF ``text`` of an asset and its entry in the manifest, in place of an earlier asset of that name."""
    write_text(root / asset.name, text)
    earlier = tuple(old for old in read_manifest(root).assets if old.name != asset.name)
    write_json(root / MANIFEST, AssetManifest(assets=(*earlier, asset)).model_dump(mode="json"))


def _make_mesh_shape(file: str) -> Shape:
    return Shape(kind="mesh", size=(1.0, 1.0, 1.0), mesh=file)
