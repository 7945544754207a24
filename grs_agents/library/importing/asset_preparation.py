"""One item of a source, from its file to a repaired, weighed and decomposed asset in metres with z up."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Final

import numpy as np

from grs_agents.base import Vec3
from grs_agents.library.asset import Asset, Origin, Physics, Quantity
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
    Collider,
    ConvexHull,
    Floats,
    ImportJob,
    ImportOptions,
    RefusedError,
    SourceModel,
    TexturedMesh,
    Unit,
    Up,
)
from grs_agents.library.mesh_files import mesh_area, mesh_volume

USUAL: Final = (0.02, 0.7)
"""Longest extent (m) that a thing on a table usually has."""
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


def prepare_asset(job: ImportJob) -> tuple[Asset, TexturedMesh, list[Collider]]:
    """The entry of an item, which names no files yet; what is seen, centred on the origin; and what touches."""
    item, options = job.item, job.options
    reading = _read_source_model(job)
    if not reading.parts:
        raise RefusedError(f"{item.file} shows nothing", "add a visual")
    solid = merge_mesh_parts(reading.parts, options.texture)
    scale, turn = _choose_scale_and_turn(solid, reading, options)
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
    solid, colliders = _center_mesh_and_solids(solid, colliders)
    x, y, z = (round(extent, 5) for extent in np.ptp(solid.vertices, axis=0).tolist())
    size: Vec3 = (x, y, z)
    if not _SIZES[0] <= max(size) <= _SIZES[1]:
        raise RefusedError(f"it is {max(size):.3g} m long, outside {_SIZES[0]} to {_SIZES[1]} m", "give its --unit")
    category = reading.category or category_from_name(item.title or item.name)
    volume = mesh_volume(solid.vertices, solid.faces) if watertight else sum(map(collider_volume, colliders))
    physics = _estimate_physics(reading, category, volume)
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


def _choose_scale_and_turn(solid: TexturedMesh, reading: SourceModel, options: ImportOptions) -> tuple[float, Floats]:
    """The scale to metres and the rotation to z up of a mesh; adds to the reading's notes what was guessed."""
    scale = METRES[_choose_length_unit(float(np.ptp(solid.vertices, axis=0).max()), reading, options)]
    vertices, up = solid.vertices * scale, options.up if reading.up == "auto" else reading.up
    if reading.height is not None:
        up = choose_up_axis_by_height(np.ptp(solid.vertices, axis=0) * scale, reading.height, up, reading.notes)
    return scale, UP_TO_Z[_choose_stable_up_axis(vertices, reading.notes) if up == "auto" else up]


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
    """The unit in which ``extent``, the longest of a thing, is usual on a table, and a note where it was not clear."""
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
    """The axis along which ``extents`` (m) are ``height``; the format's ``usual`` where another is no better by 5 %.
    A note is added where that is not the usual axis or none fits."""
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
    """z, unless the object falls over with z up and stands with y up."""
    hull = compute_convex_hull(vertices, MAX_VERTICES)

    def stands_with_axis_up(up: Up) -> bool:
        return run_drop_test([ConvexHull(hull.vertices @ UP_TO_Z[up].T, hull.faces)], 0.3, 0.6).is_stable

    if stands_with_axis_up("z") or not stands_with_axis_up("y"):
        return "z"
    notes.append("y was taken to point up: it falls over with z up")
    return "y"


def _center_mesh_and_solids(solid: TexturedMesh, colliders: Sequence[Collider]) -> tuple[TexturedMesh, list[Collider]]:
    """Mesh and colliders about the centre of the mesh's bounds."""
    middle = (solid.vertices.min(axis=0) + solid.vertices.max(axis=0)) / 2
    return replace(solid, vertices=solid.vertices - middle), [
        _subtract_center_from_collider(collider, middle) for collider in colliders
    ]


def _subtract_center_from_collider(collider: Collider, middle: Floats) -> Collider:
    if isinstance(collider, ConvexHull):
        return ConvexHull(collider.vertices - middle, collider.faces)
    x, y, z = (float(value) for value in np.asarray(collider.position) - middle)
    return collider.model_copy(update={"position": (x, y, z)})


def _estimate_physics(reading: SourceModel, category: str, volume: float) -> Physics:
    """Mass and friction as the source says, else by volume (m^3) and category."""
    mass = reading.mass
    if mass is None:
        kilograms = float(np.clip(volume * _DENSITIES.get(category, _DENSITY), *_MASSES))
        provenance, deviation = ("estimate", 0.4) if category in _DENSITIES else ("default", 0.6)
        mass = Quantity(value=float(f"{kilograms:.4g}"), provenance=provenance, deviation=deviation)
    return Physics(mass=mass, friction=reading.friction or Quantity(value=0.6, provenance="default", deviation=0.3))
