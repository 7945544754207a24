"""One item of a source, from its file to a repaired, weighed and decomposed asset in metres with z up."""

import math
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from grs_agents.base import Vec3
from grs_agents.library.asset import Asset, Physics, Quantity
from grs_agents.library.importing.appearance import category_of, colors, is_hollow, known_hope, look, sentence, ycb_mass
from grs_agents.library.importing.convex_parts import RepairedMesh, area, convex_parts, hull_volume, repair_mesh, volume
from grs_agents.library.importing.drop_test import bounds, rest
from grs_agents.library.importing.mesh_reader import read_mesh
from grs_agents.library.importing.model_descriptions import read_described
from grs_agents.library.importing.simplification import with_fewer_faces
from grs_agents.library.importing.source_folder import Folder
from grs_agents.library.importing.texture_atlas import one_mesh
from grs_agents.library.importing.types import (
    METRES,
    Collider,
    Floats,
    Hull,
    ImportOptions,
    Item,
    Reading,
    RefusedError,
    Solid,
    Unit,
    Up,
)

USUAL: Final = (0.02, 0.7)
"""Longest extent (m) that a thing on a table usually has."""
POSSIBLE: Final = (0.003, 3.0)
_TURNS: Final[dict[str, Floats]] = {
    "z": np.eye(3),
    "y": np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]]),
    "x": np.array([[0.0, 0, -1], [0, 1, 0], [1, 0, 0]]),
}
"""Rotations that take an axis to z."""


def guess_unit(extent: float) -> tuple[Unit, str]:
    """The unit in which ``extent``, the longest of a thing, is usual on a table, and a note where it was not clear."""
    units: tuple[Unit, ...] = ("m", "cm", "mm")
    low, high = USUAL
    fitting: list[Unit] = [unit for unit in units if low <= extent * METRES[unit] <= high]
    if not fitting:
        low, high = POSSIBLE
        fitting = [unit for unit in units if low <= extent * METRES[unit] <= high]
    if not fitting:
        return "m", f"its longest extent is {extent:.4g}, which is usual in no unit"
    note = (
        f"the unit is not said; {fitting[0]} was taken, for which it is {100 * extent * METRES[fitting[0]]:.3g} cm long"
    )
    if len(fitting) > 1:
        note += f" ({' and '.join(fitting[1:])} would do as well)"
    return fitting[0], note if fitting[0] != "m" or len(fitting) > 1 else ""


def turn_up(up: Up) -> Floats:
    """The rotation (3, 3) that takes the axis ``up`` to z."""
    return _TURNS["z" if up == "auto" else up]


def up_by_height(extents: Floats, height: float, usual: Up) -> Up:
    """The axis along which a thing of these extents is ``height`` high; ``usual`` where another is no better by 5 %.

    Args:
        extents: (3,) along x, y, z, m.
        height: what it is known to be, m.
        usual: the axis of its format.
    """
    axes: tuple[Up, ...] = ("x", "y", "z")
    errors = {axis: abs(float(extent) - height) / height for axis, extent in zip(axes, extents, strict=True)}
    best = min(axes, key=lambda axis: errors[axis])
    return best if usual == "auto" or errors[best] < errors[usual] - 0.05 else usual


_DENSITIES: Final = {
    "can": 900.0, "bottle": 900.0, "carton": 900.0, "jar": 900.0, "tub": 900.0, "box": 400.0, "apple": 850.0,
    "banana": 900.0, "lemon": 900.0, "orange": 900.0, "peach": 900.0, "pear": 900.0, "plum": 950.0, "bowl": 1800.0,
    "mug": 1800.0, "cup": 1200.0, "plate": 1800.0, "hammer": 3000.0, "wrench": 5000.0, "scissors": 4000.0,
    "clamp": 3000.0, "ball": 400.0, "sponge": 50.0, "block": 600.0, "toy": 400.0, "shoe": 300.0, "basket": 600.0,
}  # fmt: skip
"""kg/m^3 of things of a kind, rough."""
_DENSITY: Final = 500.0
_MASSES: Final = (0.003, 20.0)
_SIZES: Final = (0.002, 5.0)


@dataclass(frozen=True)
class Prepared:
    """A thing that can be written.

    Attributes:
        solid: what is seen; the centre of its bounds is the origin.
        colliders: what touches, in the same frame.
        physics: with provenance.
        inertia: moments (kg m^2) about the axes of the frame.
        size: extents, m.
        shape, look: see `Origin`.
        colors: names, the largest share first.
        category: a plain noun.
        description: one sentence.
        hollow: things go into it.
        notes: what was guessed, found and repaired.
    """

    solid: Solid
    colliders: tuple[Collider, ...]
    physics: Physics
    inertia: Vec3
    size: Vec3
    shape: tuple[float, ...]
    look: tuple[float, ...]
    colors: tuple[str, ...]
    category: str
    description: str
    hollow: bool
    notes: tuple[str, ...]


def prepare(folder: Folder, item: Item, options: ImportOptions, shipped: tuple[Asset, ...] = ()) -> Prepared:
    """Read an item and make a thing of it.

    Args:
        folder: the source.
        item: one of its assets.
        options: how to read it.
        shipped: assets whose size and mass are known: HOPE's kinds are looked up among them.

    Raises:
        RefusedError: it is broken, or not to be trusted; the message says why.
    """
    reading = _read(folder, item, options, shipped)
    if not reading.parts:
        raise RefusedError(f"{item.file} shows nothing", "add a visual")
    solid = one_mesh(reading.parts, options.texture)
    solid, scale, turn = _upright(solid, reading, options)
    repaired = repair_mesh(solid)
    notes = [*reading.notes, *repaired.notes]
    colliders, told = _colliders(repaired, reading, scale, turn, options)
    notes += told
    solid, colliders = _centred(repaired.solid, colliders)
    extent = np.ptp(solid.vertices, axis=0)
    size: Vec3 = (round(float(extent[0]), 5), round(float(extent[1]), 5), round(float(extent[2]), 5))
    if not _SIZES[0] <= max(size) <= _SIZES[1]:
        raise RefusedError(f"it is {max(size):.3g} m long, outside {_SIZES[0]} to {_SIZES[1]} m", "give its --unit")
    category = reading.category or category_of(item.name)
    solid_volume = volume(solid.vertices, solid.faces) if repaired.watertight else sum(map(_volume, colliders))
    physics = _physics(reading, category, solid_volume)
    standing = rest(colliders, physics.mass.value, physics.friction.value)
    if not standing.stable:
        notes.append(f"it does not rest as it stands: {standing}")
    shape = (*sorted(size), area(solid.vertices, solid.faces), solid_volume)
    hollow = is_hollow(solid)
    solid, told = with_fewer_faces(solid, options.faces, options.texture)
    names = colors(solid)
    return Prepared(
        solid=solid,
        colliders=tuple(colliders),
        physics=physics,
        inertia=_inertia(size, physics.mass.value),
        size=size,
        shape=tuple(float(f"{number:.6g}") for number in shape),
        look=look(solid),
        colors=tuple(names),
        category=category,
        description=reading.description or sentence(item.name, names, size),
        hollow=hollow,
        notes=(*notes, *told),
    )


def _read(folder: Folder, item: Item, options: ImportOptions, shipped: tuple[Asset, ...]) -> Reading:
    if item.kind in ("urdf", "mjcf"):
        return read_described(folder, item, options)
    reading = read_mesh(folder, item.file, options.limits, item.texture)
    if item.kind == "hope":
        known = known_hope(item.name, shipped)
        reading = replace(reading, unit="cm", up="y")
        if known is not None:
            reading.height, reading.category = known.size[2], known.category
            reading.mass = Quantity(value=known.mass, provenance="catalogue", deviation=0.15)
    if item.kind in ("ycb", "gso"):
        reading = replace(reading, unit="m", up="z")
    if item.kind == "ycb" and (mass := ycb_mass(item.name)) is not None:
        reading.mass = Quantity(value=mass, provenance="measured", deviation=0.02)
    return reading


def _upright(solid: Solid, reading: Reading, options: ImportOptions) -> tuple[Solid, float, Floats]:
    """The solid in metres with z up, and the scale and rotation that made it so."""
    extents = np.ptp(solid.vertices, axis=0)
    unit, note = options.unit if reading.unit == "auto" else reading.unit, ""
    if unit == "auto":
        unit, note = guess_unit(float(extents.max()))
    elif options.unit == "auto" and not 0.003 <= float(extents.max()) * METRES[unit] <= 3.0:
        guessed, _ = guess_unit(float(extents.max()))
        told = f"{float(extents.max()) * METRES[unit]:.3g} m long"
        note = f"in {unit}, as its format says, it would be {told}; {guessed} was taken"
        unit = guessed
    reading.notes += [note] if note else []
    scale = METRES[unit]
    up: Up = options.up if options.up != "auto" and reading.up == "auto" else reading.up
    if reading.height is not None:
        chosen = up_by_height(extents * scale, reading.height, up)
        if chosen != up:
            reading.notes.append(f"{chosen} points up, by its known height of {100 * reading.height:.1f} cm")
        up = chosen
        height = float(extents["xyz".index(up)]) * scale if up != "auto" else 0.0
        if abs(height - reading.height) > 0.1 * reading.height:
            reading.notes.append(f"it is {100 * height:.1f} cm high, its kind {100 * reading.height:.1f} cm")
    if up == "auto":
        up = _steadier(solid.vertices * scale, reading)
    turn = turn_up(up)
    return replace(solid, vertices=solid.vertices * scale @ turn.T), scale, turn


def _steadier(vertices: Floats, reading: Reading) -> Up:
    """z, unless the thing falls over with z up and stands with y up."""
    from grs_agents.library.importing.convex_parts import hull_of

    whole = hull_of(vertices, 64)
    standing: dict[Up, bool] = {}
    axes: tuple[Up, ...] = ("z", "y")
    for up in axes:
        standing[up] = rest([Hull(whole.vertices @ turn_up(up).T, whole.faces)], 0.3, 0.6).stable
        if standing[up]:
            break
    if standing.get("y"):
        reading.notes.append("y was taken to point up: it falls over with z up")
        return "y"
    return "z"


def _colliders(
    repaired: RepairedMesh, reading: Reading, scale: float, turn: Floats, options: ImportOptions
) -> tuple[list[Collider], list[str]]:
    """What touches: what the source says, else the convex parts of what is seen."""
    solid = repaired.solid
    if reading.colliders is None:
        parts, notes = convex_parts(solid.vertices, solid.faces, repaired.watertight, options.parts)
        return list(parts), notes
    if scale != 1.0 or not np.allclose(turn, np.eye(3)):
        raise RefusedError("what collides is not in the frame of what is seen", "give both in metres with z up")
    return list(reading.colliders), []


def _centred(solid: Solid, colliders: list[Collider]) -> tuple[Solid, list[Collider]]:
    middle = (solid.vertices.min(axis=0) + solid.vertices.max(axis=0)) / 2
    return replace(solid, vertices=solid.vertices - middle), [_shifted(one, middle) for one in colliders]


def _shifted(collider: Collider, middle: Floats) -> Collider:
    if isinstance(collider, Hull):
        return Hull(collider.vertices - middle, collider.faces)
    x, y, z = (float(value) for value in np.asarray(collider.position) - middle)
    return collider.model_copy(update={"position": (x, y, z)})


def _volume(collider: Collider) -> float:
    if isinstance(collider, Hull):
        return hull_volume(collider)
    low, high = bounds(collider)
    full = math.prod((high - low).tolist())
    return full * {"box": 1.0, "cylinder": np.pi / 4, "sphere": np.pi / 6}.get(collider.kind, 1.0)


def _physics(reading: Reading, category: str, solid_volume: float) -> Physics:
    mass = reading.mass
    if mass is None:
        known = category in _DENSITIES
        kilograms = float(np.clip(solid_volume * _DENSITIES.get(category, _DENSITY), *_MASSES))
        provenance, deviation = ("estimate", 0.4) if known else ("default", 0.6)
        mass = Quantity(value=float(f"{kilograms:.4g}"), provenance=provenance, deviation=deviation)
    friction = reading.friction or Quantity(value=0.6, provenance="default", deviation=0.3)
    return Physics(mass=mass, friction=friction)


def _inertia(size: Vec3, mass: float) -> Vec3:
    """Of a box of these extents: what URDF readers other than ours see."""
    x, y, z = size
    return (mass * (y * y + z * z) / 12, mass * (x * x + z * z) / 12, mass * (x * x + y * y) / 12)
