"""An item of a source, from its file to an asset in the library: repaired, weighed, decomposed, in metres with z up.

The worker's part of an import: it holds no keys and opens no other file.
"""

import hashlib
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

import numpy as np

from grs_agents.base import Vec3
from grs_agents.base.files import write_bytes
from grs_agents.base.geometry.transforms import to_vec3
from grs_agents.library.asset import DEFAULT_FRICTION, Asset, Origin, PhysicalProperties, Quantity
from grs_agents.library.asset_rendering import render_random_views
from grs_agents.library.formats.model_file import MAX_PARTS
from grs_agents.library.formats.urdf import format_urdf_text
from grs_agents.library.importing.convex_decomposition import (
    MAX_VERTICES,
    compute_convex_hull,
    decompose_into_convex_parts,
    repair_mesh,
)
from grs_agents.library.importing.drop_testing import collider_volume, run_drop_test
from grs_agents.library.importing.mesh_appearance import (
    category_from_name,
    describe_color_and_size,
    find_shipped_hope_asset,
    is_hollow,
    look_up_ycb_mass_kg,
    surface_color_histogram,
    surface_color_names,
)
from grs_agents.library.importing.mesh_reader import read_mesh
from grs_agents.library.importing.mesh_simplification import simplify_textured_mesh
from grs_agents.library.importing.model_descriptions import read_urdf_or_mjcf
from grs_agents.library.importing.source_folder import SourceFolder
from grs_agents.library.importing.texture_atlas import merge_mesh_parts
from grs_agents.library.importing.types import (
    METRES,
    UP_TO_Z,
    AtlasMesh,
    Collider,
    ConvexHull,
    Floats,
    ImportJob,
    ImportOptions,
    RefusedError,
    SourceModel,
    Unit,
    Up,
)
from grs_agents.library.library import Library
from grs_agents.library.mesh_files import box_inertia, encode_png, format_obj_text, mesh_area, mesh_volume
from grs_agents.library.shapes import Shape
from grs_agents.sandbox.harness.answers import answer_or_refuse, send_blob

USUAL: Final = (0.02, 0.7)
"""Usual longest extent (m) of an object on a table."""
POSSIBLE: Final = (0.003, 3.0)
_CATEGORIES: Final = """
    50: sponge | 300: shoe | 400: box ball toy | 600: block basket | 850: apple | 950: plum | 1200: cup
    900: can bottle carton jar tub banana lemon orange peach pear | 1800: bowl mug plate | 3000: hammer clamp
    4000: scissors | 5000: wrench
"""
_ROWS: Final = [row.partition(":") for row in _CATEGORIES.replace("\n", "|").split("|") if row.strip()]
_DENSITIES: Final = {category: float(density) for density, _, names in _ROWS for category in names.split()}
"""kg/m^3 of things of a kind, rough."""
_DENSITY: Final = 500.0
_MASSES: Final = (0.003, 20.0)
_SIZES: Final = (0.002, 5.0)
_TRIAL_MASS: Final = 0.3
"""kg, in the drop test that chooses the up axis, before the mass is known."""


def prepare_asset(job: ImportJob) -> tuple[Asset, AtlasMesh, list[Collider]]:
    """Prepare an item. Returns: its entry without files, its mesh centred on the origin, its colliders."""
    item, options = job.item, job.options
    reading = _read_source_model(job)
    if not reading.parts:
        raise RefusedError(f"{item.file} shows nothing", "add a visual")
    solid = merge_mesh_parts(reading.parts, options.texture)
    scale = METRES[_choose_length_unit(float(np.ptp(solid.vertices, axis=0).max()), reading, options)]
    vertices, up = solid.vertices * scale, options.up if reading.up == "auto" else reading.up
    if reading.height is not None:
        up = choose_up_axis_by_height(np.ptp(solid.vertices, axis=0) * scale, reading.height, up, reading.notes)
    turn = UP_TO_Z[_choose_stable_up_axis(vertices, reading.notes) if up == "auto" else up]
    solid, watertight, repairs = repair_mesh(replace(solid, vertices=solid.vertices * scale @ turn.T))
    notes = [*reading.notes, *repairs]
    if reading.colliders is None:
        colliders, more = decompose_into_convex_parts(solid.vertices, solid.faces, watertight, options.parts)
        notes += more
    elif scale != 1.0 or not np.allclose(turn, np.eye(3)):
        extent = float(np.ptp(solid.vertices, axis=0).max() / scale)
        low, high = POSSIBLE
        message = f"in metres, as its format says, it would be {extent:.3g} m long, outside {low} to {high} m"
        raise RefusedError(message, "scale what is seen and what collides to metres, with z up")
    else:
        colliders = reading.colliders
    middle = (solid.vertices.min(axis=0) + solid.vertices.max(axis=0)) / 2
    solid = replace(solid, vertices=solid.vertices - middle)
    colliders = [
        ConvexHull(collider.vertices - middle, collider.faces)
        if isinstance(collider, ConvexHull)
        else collider.model_copy(update={"position": to_vec3(np.asarray(collider.position) - middle)})
        for collider in colliders
    ]
    x, y, z = (round(extent, 5) for extent in np.ptp(solid.vertices, axis=0).tolist())
    size: Vec3 = (x, y, z)
    if not _SIZES[0] <= max(size) <= _SIZES[1]:
        raise RefusedError(f"it is {max(size):.3g} m long, outside {_SIZES[0]} to {_SIZES[1]} m", "give its --unit")
    category = reading.category or category_from_name(item.title or item.name)
    volume = mesh_volume(solid.vertices, solid.faces) if watertight else sum(map(collider_volume, colliders))
    mass = reading.mass
    if mass is None:
        kilograms = float(np.clip(volume * _DENSITIES.get(category, _DENSITY), *_MASSES))
        provenance, deviation = ("estimate", 0.4) if category in _DENSITIES else ("default", 0.6)
        mass = Quantity(value=float(f"{kilograms:.4g}"), provenance=provenance, deviation=deviation)
    physics = PhysicalProperties(mass=mass, friction=reading.friction or DEFAULT_FRICTION)
    result = run_drop_test(colliders, physics.mass.value, physics.friction.value)
    notes += [] if result.is_stable else [f"it does not rest as it stands: {result}"]
    shape, hollow = (*sorted(size), mesh_area(solid.vertices, solid.faces), volume), is_hollow(solid)
    solid, more = simplify_textured_mesh(solid, options.faces, options.texture)
    names = surface_color_names(solid)
    origin = Origin(
        collection=job.collection,
        source=item.file,
        license=job.license,
        content=job.content,
        shape=tuple(float(f"{number:.6g}") for number in shape),
        look=surface_color_histogram(solid),
        notes=(*notes, *more),
    )
    asset = Asset(
        name=f"{job.collection}/{item.name}.urdf",
        kind=item.name,
        category=category,
        size=size,
        mass=physics.mass.value,
        friction=physics.friction.value,
        color=names[0],
        description=describe_color_and_size(item.title or item.name, names, size),
        hollow=hollow,
        physics=physics,
        origin=origin,
    )
    return asset, solid, colliders


def _read_source_model(job: ImportJob) -> SourceModel:
    item, options = job.item, job.options
    folder = SourceFolder(job.source, options.limits.bytes)
    if item.kind in ("urdf", "mjcf"):
        return read_urdf_or_mjcf(folder, item, options)
    reading = read_mesh(folder, item.file, options.limits, item.texture)
    if item.kind == "hope":
        known = find_shipped_hope_asset(item.name, job.known)
        reading = replace(reading, unit="cm", up="y")
        if known is not None:
            reading.height, reading.category = known.size[2], known.category
            reading.mass = Quantity(value=known.mass, provenance="catalogue", deviation=0.15)
    if item.kind in ("ycb", "gso"):
        reading = replace(reading, unit="m", up="z")
    if item.kind == "ycb" and (mass := look_up_ycb_mass_kg(item.name)) is not None:
        reading.mass = Quantity(value=mass, provenance="measured", deviation=0.02)
    return reading


def _choose_length_unit(extent: float, reading: SourceModel, options: ImportOptions) -> Unit:
    """The unit that the user or the format says, unless it cannot be or there is none: then a guess, with a note."""
    unit = options.unit if reading.unit == "auto" else reading.unit
    if unit == "auto":
        unit, note = guess_length_unit(extent)
        reading.notes += [note] if note else []
    elif options.unit == "auto" and not POSSIBLE[0] <= extent * METRES[unit] <= POSSIBLE[1]:
        guessed, _ = guess_length_unit(extent)
        length = f"{extent * METRES[unit]:.3g} m long"
        reading.notes.append(f"in {unit}, as its format says, it would be {length}; {guessed} was taken")
        return guessed
    return unit


def guess_length_unit(extent: float) -> tuple[Unit, str]:
    """The unit in which the longest ``extent`` is usual on a table, and a note if it was ambiguous."""
    units: tuple[Unit, ...] = ("m", "cm", "mm")
    fitting: list[Unit] = []
    for low, high in (USUAL, POSSIBLE):
        fitting = fitting or [unit for unit in units if low <= extent * METRES[unit] <= high]
    if not fitting:
        return "m", f"its longest extent is {extent:.4g}, which is usual in no unit"
    if fitting == ["m"]:
        return "m", ""
    length = f"{100 * extent * METRES[fitting[0]]:.3g} cm long"
    note = f"the unit is not said; {fitting[0]} was taken, for which it is {length}"
    return fitting[0], note + (f" ({' and '.join(fitting[1:])} would do as well)" if len(fitting) > 1 else "")


def choose_up_axis_by_height(extents: Floats, height: float, usual: Up, notes: list[str]) -> Up:
    """The axis along which ``extents`` (m) best fit ``height``; the format's ``usual`` axis unless another is better by
    5 %. A note is added if it is not the usual axis or none fits."""
    axes: tuple[Up, ...] = ("x", "y", "z")
    errors = {axis: abs(float(extent) - height) / height for axis, extent in zip(axes, extents, strict=True)}
    best = min(axes, key=lambda axis: errors[axis])
    up = best if usual == "auto" or errors[best] < errors[usual] - 0.05 else usual
    if up != usual:
        notes.append(f"{up} points up, by its known height of {100 * height:.1f} cm")
    measured = float(extents["xyz".index(up)])
    if abs(measured - height) > 0.1 * height:
        notes.append(f"it is {100 * measured:.1f} cm high, its kind {100 * height:.1f} cm")
    return up


def _choose_stable_up_axis(vertices: Floats, notes: list[str]) -> Up:
    """z, unless the object falls over with z up and is stable with y up."""
    hull = compute_convex_hull(vertices, MAX_VERTICES)

    def stands_with_axis_up(up: Up) -> bool:
        return run_drop_test(
            [ConvexHull(hull.vertices @ UP_TO_Z[up].T, hull.faces)], _TRIAL_MASS, DEFAULT_FRICTION.value
        ).is_stable

    if stands_with_axis_up("z") or not stands_with_axis_up("y"):
        return "z"
    notes.append("y was taken to point up: it falls over with z up")
    return "y"


def write_asset_files(root: Path, asset: Asset, solid: AtlasMesh, colliders: Sequence[Collider]) -> Asset:
    """Write the URDF, OBJ, PNG, convex parts and views of an asset below the library ``root``.

    Returns: the asset's entry with the hashes of its files; it is not in the manifest yet.
    """
    collection, _, urdf = asset.name.rpartition("/")
    slug = urdf.removesuffix(".urdf")
    base, texture = f"{collection}/meshes/{slug}", f"{collection}/textures/{slug}.png"
    uvs, uv_indices = np.unique(np.round(solid.uvs.reshape(-1, 2), 5), axis=0, return_inverse=True)
    mesh = format_obj_text(solid.vertices, solid.faces, uvs, uv_indices.reshape(-1, 3))
    files = {f"{base}.obj": mesh.encode(), texture: encode_png(solid.image)}
    hulls = [collider for collider in colliders if isinstance(collider, ConvexHull)]
    for number, hull in enumerate(hulls):
        files[f"{base}.part{number}.obj"] = format_obj_text(hull.vertices, hull.faces).encode()
    visual = Shape(kind="mesh", size=(1.0, 1.0, 1.0), mesh=f"{base}.obj", texture=texture, color=(1.0, 1.0, 1.0, 1.0))
    shapes = [collider for collider in colliders if isinstance(collider, Shape)]
    shapes += [Shape(kind="mesh", size=(1.0, 1.0, 1.0), mesh=f"{base}.obj")] if hulls else []
    inertia = box_inertia(asset.size, asset.mass)
    text = format_urdf_text(
        slug, [visual], shapes, mass=asset.mass, friction=asset.friction, inertia=inertia, folder=collection
    )
    files[asset.name] = text.encode()
    for number in range(len(hulls), MAX_PARTS):
        (root / f"{collection}/meshes/{asset.kind}.part{number}.obj").unlink(missing_ok=True)  # of an earlier import
    for name, data in files.items():
        write_bytes(root / name, data)
    for number, view in enumerate(render_random_views(Library(root), asset.name)):
        write_bytes(asset_view_path(root, asset.name, number), encode_png(view.rgba))
    digests = {name: hashlib.sha256(data).hexdigest() for name, data in files.items()}
    return asset.model_copy(update={"origin": asset.origin and asset.origin.model_copy(update={"files": digests})})


def asset_view_path(root: Path, name: str, number: int) -> Path:
    """Path of the picture of an asset's random view ``number``."""
    urdf = root / name
    return urdf.parent / "views" / f"{urdf.stem}-{number}.png"


def inside(request: dict[str, Any]) -> dict[str, Any]:
    """Entry of the worker: do the ``job`` and send its files as blobs."""
    return answer_or_refuse(lambda: _prepare_and_send(ImportJob.model_validate(request["job"])))


def _prepare_and_send(job: ImportJob) -> dict[str, Any]:
    root = Path.cwd()  # the scratch folder
    asset = write_asset_files(root, *prepare_asset(job))
    for file in sorted(root.rglob("*")):
        if file.is_file():
            send_blob(file.relative_to(root).as_posix(), file.read_bytes())
    return {"asset": asset.model_dump(mode="json")}
