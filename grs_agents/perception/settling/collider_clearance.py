"""Colliders that reach into those of other objects are cut back to planes between them, so that nothing need move."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from enum import IntEnum

import numpy as np

from grs_agents.base.mujoco_import import mujoco
from grs_agents.library.library import Library
from grs_agents.library.mesh_files import read_vertices
from grs_agents.library.shapes import Shape, matrix_from_quaternion
from grs_agents.perception.configuration import DEFAULT
from grs_agents.perception.shapes.colliders import Collider, Hull, clip_hull_corners_to_half_space
from grs_agents.perception.types import Array, Mask

CONFIG = DEFAULT.settling.clearance
_AROUND = 24
_ANGLES = np.arange(_AROUND) * 2 * np.pi / _AROUND
_SIDEWAYS = np.column_stack([np.cos(_ANGLES), np.sin(_ANGLES), np.zeros(_AROUND)])


class Rank(IntEnum):
    """How little an object gives way."""

    SOLID = 0
    HOLLOW = 1  # its walls are thin: none would be left
    ASSET = 2  # of the library: it is as it is


@dataclass(frozen=True)
class PlacedColliders:
    """The colliders of an object, and where its frame is."""

    colliders: Sequence[Collider]
    pose: Array  # (4, 4) from the object's frame to the robot frame, m
    # who gives way where two are in each other: the one of the lower rank; of the same rank both, but not assets
    rank: Rank = Rank.SOLID


def colliders_of_asset(name: str, library: Library) -> list[Collider]:
    """What touches of an asset, in its own frame."""
    return [
        shape if shape.kind != "mesh" else Hull(_mesh_corners(shape, library))
        for shape in library.load_object_model(name).colliders
    ]


def _mesh_corners(shape: Shape, library: Library) -> Array:
    vertices = read_vertices(library.mesh_or_texture_path(shape.mesh or "")) * np.asarray(shape.size)
    return vertices @ matrix_from_quaternion(shape.quaternion).T + shape.position


@dataclass
class _Part:
    """One collider as the corners of a hull in the robot frame, (N, 3) m; none where nothing is left of it."""

    owner: int
    corners: Array
    cut: bool = False


@dataclass(frozen=True)
class _Overlap:
    """How two parts, by number, are in each other; ``normal`` points from the first to the second."""

    parts: tuple[int, int]
    depth: float  # m
    point: Array  # (3,) in the middle of it, m, robot frame
    normal: Array  # (3,)


def clear_colliders(placed: Sequence[PlacedColliders]) -> list[tuple[Collider, ...]]:
    """The colliders of each object, cut back to planes half way where they are in each other, or to what stays.

    An object that would lose too much stays whole, and the others give way. Where they would too, one has to be moved.
    """
    parts = list(_parts_in_robot_frame(placed))
    whole = [part.corners for part in parts]
    ranks = [one.rank for one in placed]
    first: Array | None = None
    for _ in range(CONFIG.rounds):
        overlaps, volumes = _measure_overlaps(parts, len(placed))
        first = volumes if first is None else first
        restored = _restore_what_is_cut_too_far(parts, whole, ranks, volumes < CONFIG.kept * first)
        if not overlaps and not restored:
            break
        if restored:  # others give way to it
            overlaps, _ = _measure_overlaps(parts, len(placed))
        for overlap in overlaps:
            _cut_parts_apart(parts, overlap, ranks)
    pairs = iter(parts)
    return [tuple(_cut_colliders(one, [next(pairs) for _ in one.colliders])) for one in placed]


def _parts_in_robot_frame(placed: Sequence[PlacedColliders]) -> Iterator[_Part]:
    for owner, one in enumerate(placed):
        for collider in one.colliders:
            yield _Part(owner, _collider_corners(collider) @ one.pose[:3, :3].T + one.pose[:3, 3])


def _collider_corners(collider: Collider) -> Array:
    """The corners (N, 3) of a collider, of a round one on a circle around it."""
    if isinstance(collider, Hull):
        return collider.corners
    if collider.kind == "box":
        local = (np.indices((2, 2, 2)).reshape(3, -1).T - 0.5) * collider.size
    else:
        radius, length = collider.size[0], collider.size[1] if collider.kind == "cylinder" else 2 * collider.size[0]
        ring = _SIDEWAYS[:, :2] * radius
        local = np.concatenate([np.column_stack([ring, np.full(_AROUND, side * length / 2)]) for side in (-1, 1)])
    return local @ matrix_from_quaternion(collider.quaternion).T + collider.position


def _measure_overlaps(parts: Sequence[_Part], count: int) -> tuple[list[_Overlap], Array]:
    """Which parts of different objects are in each other, the deepest first; and the volume of each object, m^3."""
    spec = mujoco.MjSpec()
    bodies = [spec.worldbody.add_body(name=str(owner)) for owner in range(count)]
    for body in bodies:
        body.add_freejoint()
        body.add_geom(type=mujoco.mjtGeom.mjGEOM_SPHERE, size=(1e-3, 0, 0), contype=0, conaffinity=0, mass=1e-6)
    for number, part in enumerate(parts):
        if len(part.corners):
            spec.add_mesh(name=str(number), uservert=part.corners.ravel().tolist())
            bodies[part.owner].add_geom(
                name=str(number), type=mujoco.mjtGeom.mjGEOM_MESH, meshname=str(number), density=1.0
            )
    model = spec.compile()
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    found: dict[tuple[int, int], _Overlap] = {}
    for contact in data.contact:
        one, other = (int(model.geom(int(geom)).name) for geom in contact.geom)
        depth, known = -float(contact.dist), found.get((one, other))
        if depth > CONFIG.deep and (known is None or depth > known.depth):
            found[one, other] = _Overlap((one, other), depth, np.array(contact.pos), np.array(contact.frame[:3]))
    return sorted(found.values(), key=lambda overlap: -overlap.depth), np.asarray(model.body_mass[1:], np.float64)


def _sideways_if_beside(parts: Sequence[_Part], overlap: _Overlap) -> _Overlap:
    """The overlap as it is, or measured sideways where neither object lies on the other.

    The shortest way out of a thin floor is up. What stands as low as that floor, its middle beside it, would lose its
    underside to it, and fall.
    """
    up = 1 if overlap.normal[2] > 0 else -1
    below, above = (parts[number] for number in overlap.parts[::up])
    lies_on = above.corners[:, 2].min() > below.corners[:, 2].min() + CONFIG.deep
    if abs(overlap.normal[2]) < CONFIG.upright or lies_on or _is_over(above.owner, below.owner, parts):
        return overlap
    reach = (below.corners @ _SIDEWAYS.T).max(axis=0) - (above.corners @ _SIDEWAYS.T).min(axis=0)
    best = int(reach.argmin())
    middle = (below.corners @ _SIDEWAYS[best]).max() - reach[best] / 2
    return replace(overlap, depth=float(reach[best]), point=middle * _SIDEWAYS[best], normal=up * _SIDEWAYS[best])


def _is_over(above: int, below: int, parts: Sequence[_Part]) -> bool:
    """Whether the middle of an object is over the outline of another."""
    one, other = (np.concatenate([part.corners for part in parts if part.owner == owner]) for owner in (above, below))
    return bool((_SIDEWAYS @ one.mean(axis=0) <= (other @ _SIDEWAYS.T).max(axis=0)).all())


def _cut_parts_apart(parts: Sequence[_Part], overlap: _Overlap, ranks: Sequence[Rank]) -> None:
    """Cut two parts to either side of a plane, or the one of the lower rank."""
    one, other = (parts[number] for number in overlap.parts)
    if not (len(one.corners) and len(other.corners)):  # nothing is left of one by now
        return
    overlap = _sideways_if_beside(parts, overlap)
    first, second = ranks[one.owner], ranks[other.owner]
    normal, shift = overlap.normal, overlap.depth / 2 * ((second < first) - (first < second))
    if first == second:
        normal = _upright_or_level(normal)
    place = float(normal @ overlap.point) + shift  # towards the one that gives way
    for part, side, gives_way in ((one, 1, first <= second), (other, -1, second <= first)):
        if gives_way and ranks[part.owner] < Rank.ASSET:
            left = clip_hull_corners_to_half_space(part.corners, side * normal, side * place)
            thick = len(left) > 3 and _least_extent_of_hull(left) > CONFIG.thinnest
            part.corners, part.cut = left if thick else left[:0], True


def _upright_or_level(normal: Array) -> Array:
    """The normal (3,) of a plane, made upright or level if it nearly is: what lies on a level one does not tilt."""
    if abs(normal[2]) < CONFIG.upright:
        return normal * (1, 1, 0) / np.linalg.norm(normal[:2])
    return np.sign(normal) * (0, 0, 1) if abs(normal[2]) > CONFIG.level else normal


def _least_extent_of_hull(corners: Array) -> float:
    """About the least extent of a hull in any direction, m."""
    centered = corners - corners.mean(axis=0)
    return float(np.ptp(centered @ np.linalg.svd(centered, full_matrices=False)[2][2]))


def _restore_what_is_cut_too_far(
    parts: Sequence[_Part], whole: Sequence[Array], ranks: list[Rank], too_small: Mask
) -> bool:
    """Make whole what is ``too_small`` (owners,) now, and cut it no more; whether there is any."""
    owners = [owner for owner in np.flatnonzero(too_small).tolist() if ranks[owner] < Rank.ASSET]
    for owner in owners:
        ranks[owner] = Rank.ASSET
    for part, corners in zip(parts, whole, strict=True):
        if part.owner in owners:
            part.corners, part.cut = corners, False
    return bool(owners)


def _cut_colliders(placed: PlacedColliders, parts: Sequence[_Part]) -> Iterator[Collider]:
    """What is left of colliders, in the object's frame."""
    for collider, part in zip(placed.colliders, parts, strict=True):
        if not part.cut:
            yield collider
        elif len(part.corners):
            yield Hull((part.corners - placed.pose[:3, 3]) @ placed.pose[:3, :3])
