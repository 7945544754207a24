"""Place proxies clear of other objects and steadily.

Overlapping colliders are cut back to planes between them, so that no object needs to move. A proxy that would sink as
it settles is lengthened down to its support, since the photo does not show its underside; a proxy that would tip over
gets primitive colliders.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from enum import IntEnum
from pathlib import Path

import numpy as np

from grs_agents.base.geometry.transforms import matrix_to_quaternion, pose_matrix, to_vec3
from grs_agents.base.mujoco_import import mujoco
from grs_agents.library.library import Library
from grs_agents.library.mesh_files import read_vertices
from grs_agents.library.shapes import matrix_from_quaternion
from grs_agents.perception.configuration import DEFAULT
from grs_agents.perception.proxies.proxy import Proxy, primitive_proxy, write_proxy
from grs_agents.perception.settling.settling import (
    PlacedObject,
    RestPose,
    RestState,
    settle_and_measure_fidelity,
    to_instance_objects,
)
from grs_agents.perception.shapes.colliders import Collider, Hull, clip_hull_corners_to_half_space, lower_underside
from grs_agents.perception.shapes.types import object_pose
from grs_agents.perception.types import Array, Mask, RGBDFrame, Solid, TableFrame, TwinReport, UprightBox

CONFIG = DEFAULT.settling.clearance
_AROUND = 24
_ANGLES = np.arange(_AROUND) * 2 * np.pi / _AROUND
_SIDEWAYS = np.column_stack([np.cos(_ANGLES), np.sin(_ANGLES), np.zeros(_AROUND)])


def extend_box_to_support(box: UprightBox) -> UprightBox:
    """The box lengthened down into its support; the overlap is cut off both by `clear_colliders`.

    Its underside was clipped on a grid, and the support may be flatter than it appeared.
    """
    (x, y, z), (length, width, height) = box.center, box.size
    lower = min(max(z - height / 2, 0.0), CONFIG.hovers)
    return box.model_copy(update={"center": (x, y, z - lower / 2), "size": (length, width, height + lower)})


@dataclass(frozen=True, eq=False)
class PlacedProxy:
    """An object without an asset: its proxy, in the frame of its box."""

    name: str  # of the proxy
    description: str
    solid: Solid  # primitive that fills its box
    box: UprightBox
    proxy: Proxy


@dataclass(frozen=True)
class SteadyScene:
    """Objects as they are placed, their rest poses, and the report on the twin."""

    placed: list[PlacedObject]
    rest: RestState
    twin: TwinReport


def place_with_cleared_colliders(
    objects: Sequence[PlacedObject | PlacedProxy], folder: Path, library: Library
) -> list[PlacedObject]:
    """Write the proxies into ``folder``, with colliders clear of all other objects.

    Raises:
        InputError: the folder cannot be written.
    """
    placed: list[PlacedObject] = []
    for item in _clear_colliders_of_proxies(objects, library):
        if isinstance(item, PlacedProxy):
            asset = write_proxy(folder, item.name, item.proxy, item.description)
            pose = object_pose(item.box)
            position = to_vec3(pose[:3, :3] @ item.proxy.center + pose[:3, 3])
            placed.append(PlacedObject(asset.name, (position, matrix_to_quaternion(pose[:3, :3])), guessed=True))
        else:
            placed.append(item)
    return placed


def _clear_colliders_of_proxies(
    objects: Sequence[PlacedObject | PlacedProxy], library: Library
) -> list[PlacedObject | PlacedProxy]:
    """The objects, with the colliders of proxies cut clear of all others."""
    placed: list[PlacedColliders] = []
    for item in objects:
        if isinstance(item, PlacedProxy):
            rank = Rank.HOLLOW if item.proxy.hollow else Rank.SOLID
            placed.append(PlacedColliders(item.proxy.colliders, object_pose(item.box), rank))
        else:
            (instance,) = to_instance_objects([item], library)
            position, turn = instance.pose
            pose = pose_matrix(matrix_from_quaternion(turn), np.array(position))
            placed.append(PlacedColliders(colliders_of_asset(item.asset, library), pose, Rank.ASSET))
    return [
        replace(item, proxy=replace(item.proxy, colliders=colliders)) if isinstance(item, PlacedProxy) else item
        for item, colliders in zip(objects, clear_colliders(placed), strict=True)
    ]


def settle_with_stable_colliders(
    objects: Sequence[PlacedObject | PlacedProxy],
    folder: Path,
    library: Callable[[], Library],
    frame: RGBDFrame,
    table: TableFrame,
    mask: Mask,
) -> SteadyScene:
    """Write the proxies, and settle all objects; unstable proxies get other colliders, and all settle once more.

    The second scene is kept only if it has fewer unstable proxies.

    Args:
        objects: assets and proxies where the photo shows them.
        folder: the library of the run; the proxies are written there.
        library: reads the library with the present content of that folder.
        frame: the photo.
        table: the table in it.
        mask: (H, W) pixels at which the twin is compared with the photo.

    Raises:
        SimulationError: MuJoCo rejects the scene.
    """

    def place_and_settle(objects: Sequence[PlacedObject | PlacedProxy]) -> SteadyScene:
        placed = place_with_cleared_colliders(objects, folder, library())
        return SteadyScene(placed, *settle_and_measure_fidelity(placed, library(), frame, table, mask))

    first = place_and_settle(objects)
    unstable = [*map(_is_proxy_unstable, objects, first.placed, first.rest.placed)]
    if not any(unstable):
        return first
    cleared = _clear_colliders_of_proxies(objects, library())
    stable: list[PlacedObject | PlacedProxy] = []
    for item, clear, is_unstable, placed, end in zip(
        objects, cleared, unstable, first.placed, first.rest.placed, strict=True
    ):
        if is_unstable and isinstance(item, PlacedProxy) and isinstance(clear, PlacedProxy):
            if (  # only lower at rest
                end is not None
                and end.pose[0][2] < placed.pose[0][2]
                and float(np.hypot(*np.subtract(end.pose[0], placed.pose[0])[:2])) < CONFIG.aside
                and _tilt_angle(placed, end) < CONFIG.tilted
            ):
                colliders = lower_underside(clear.proxy.colliders, placed.pose[0][2] - end.pose[0][2])
            else:
                primitive = primitive_proxy(item.solid, item.box.size, item.proxy.color, item.proxy.hollow)
                colliders = primitive.colliders
            stable.append(replace(item, proxy=replace(item.proxy, colliders=colliders)))
        else:
            stable.append(item)
    second = place_and_settle(stable)
    if sum(map(_is_proxy_unstable, objects, second.placed, second.rest.placed)) < sum(unstable):
        return second
    place_with_cleared_colliders(objects, folder, library())
    return first


def _is_proxy_unstable(item: PlacedObject | PlacedProxy, placed: PlacedObject, end: RestPose | None) -> bool:
    """Whether a proxy leaves its pose in the photo as it settles."""
    if not isinstance(item, PlacedProxy) or end is None:
        return False
    moved = end.drift > CONFIG.moved or _tilt_angle(placed, end) > CONFIG.tilted
    on_table = item.box.center[2] - item.box.size[2] / 2 < CONFIG.hovers
    return moved or (end.held and on_table)


def _tilt_angle(placed: PlacedObject, end: RestPose) -> float:
    """Angle between the object's vertical axis as placed and at rest, rad."""
    upright = float(matrix_from_quaternion(placed.pose[1])[2] @ matrix_from_quaternion(end.pose[1])[2])
    return float(np.arccos(min(upright, 1.0)))


class Rank(IntEnum):
    """Resistance of an object to being cut; the lower of two ranks is cut."""

    SOLID = 0
    HOLLOW = 1  # thin walls, of which a cut would leave nothing
    ASSET = 2  # of the library: never cut


@dataclass(frozen=True)
class PlacedColliders:
    """The colliders of an object at a pose."""

    colliders: Sequence[Collider]
    pose: Array  # (4, 4) from the object's frame to the robot frame, m
    rank: Rank = Rank.SOLID  # of two objects of the same rank both are cut, except assets


def colliders_of_asset(name: str, library: Library) -> list[Collider]:
    """The colliders of an asset in its own frame, meshes as hulls."""
    colliders: list[Collider] = []
    for shape in library.load_object_model(name).colliders:
        if shape.kind == "mesh":
            vertices = read_vertices(library.mesh_or_texture_path(shape.mesh or "")) * np.asarray(shape.size)
            colliders.append(Hull(vertices @ matrix_from_quaternion(shape.quaternion).T + shape.position))
        else:
            colliders.append(shape)
    return colliders


@dataclass
class _Part:
    """A collider as the corners (N, 3) of a hull in the robot frame, m; empty if it was cut off completely."""

    owner: int
    corners: Array
    cut: bool = False


@dataclass(frozen=True)
class _Overlap:
    """The overlap of two parts, by number; ``normal`` points from the first to the second."""

    parts: tuple[int, int]
    depth: float  # m
    point: Array  # (3,) in the middle of it, m, robot frame
    normal: Array  # (3,)


def clear_colliders(placed: Sequence[PlacedColliders]) -> list[tuple[Collider, ...]]:
    """Cut the colliders of each object back to planes half way through each overlap.

    An object that would lose too much volume stays whole, and the others are cut. Where these would lose too much as
    well, the overlap stays.
    """
    parts = [
        _Part(owner, _collider_corners(collider) @ item.pose[:3, :3].T + item.pose[:3, 3])
        for owner, item in enumerate(placed)
        for collider in item.colliders
    ]
    whole = [part.corners for part in parts]
    ranks = [item.rank for item in placed]
    first: Array | None = None
    for _ in range(CONFIG.rounds):
        overlaps, volumes = _measure_overlaps(parts, len(placed))
        first = volumes if first is None else first
        too_small = volumes < CONFIG.kept * first
        restored = [owner for owner in np.flatnonzero(too_small).tolist() if ranks[owner] < Rank.ASSET]
        for owner in restored:
            ranks[owner] = Rank.ASSET
        for part, corners in zip(parts, whole, strict=True):
            if part.owner in restored:
                part.corners, part.cut = corners, False
        if not overlaps and not restored:
            break
        if restored:  # the others are cut for them
            overlaps, _ = _measure_overlaps(parts, len(placed))
        for overlap in overlaps:
            _cut_parts_apart(parts, overlap, ranks)
    remaining = iter(parts)
    cleared: list[tuple[Collider, ...]] = []
    for item in placed:
        colliders: list[Collider] = []
        for collider in item.colliders:
            part = next(remaining)
            if not part.cut:
                colliders.append(collider)
            elif len(part.corners):
                colliders.append(Hull((part.corners - item.pose[:3, 3]) @ item.pose[:3, :3]))
        cleared.append(tuple(colliders))
    return cleared


def _collider_corners(collider: Collider) -> Array:
    """Corners (N, 3) of a collider in the object's frame; of a round collider, on circles around it."""
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
    """The overlaps of parts of different objects, the deepest first, and the volume of each object, m^3.

    MuJoCo detects the contacts and integrates the volumes (masses at density 1).
    """
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
    deepest: dict[tuple[int, int], _Overlap] = {}
    for contact in data.contact:
        first, second = (int(model.geom(int(geom)).name) for geom in contact.geom)
        depth, known = -float(contact.dist), deepest.get((first, second))
        if depth > CONFIG.deep and (known is None or depth > known.depth):
            deepest[first, second] = _Overlap(
                (first, second), depth, np.array(contact.pos), np.array(contact.frame[:3])
            )
    return sorted(deepest.values(), key=lambda overlap: -overlap.depth), np.asarray(model.body_mass[1:], np.float64)


def _cut_parts_apart(parts: Sequence[_Part], overlap: _Overlap, ranks: Sequence[Rank]) -> None:
    """Cut two parts to either side of a plane, or only the part of the lower rank."""
    first, second = (parts[number] for number in overlap.parts)
    if not (len(first.corners) and len(second.corners)):  # an earlier cut has removed one of them
        return
    overlap = _measure_sideways_if_beside(parts, overlap)
    first_rank, second_rank = ranks[first.owner], ranks[second.owner]
    normal, shift = overlap.normal, overlap.depth / 2 * ((second_rank < first_rank) - (first_rank < second_rank))
    if first_rank == second_rank:  # a nearly level or upright plane becomes exactly so: no tilt for what lies on it
        if abs(normal[2]) < CONFIG.upright:
            normal = normal * (1, 1, 0) / np.linalg.norm(normal[:2])
        elif abs(normal[2]) > CONFIG.level:
            normal = np.sign(normal) * (0, 0, 1)
    offset = float(normal @ overlap.point) + shift  # of the plane, shifted into the part that is cut
    cuts = ((first, 1, first_rank <= second_rank), (second, -1, second_rank <= first_rank))
    for part, side, is_cut in cuts:
        if is_cut and ranks[part.owner] < Rank.ASSET:
            left = clip_hull_corners_to_half_space(part.corners, side * normal, side * offset)
            if len(left) > 3:
                centered = left - left.mean(axis=0)
                thinnest_axis = np.linalg.svd(centered, full_matrices=False)[2][2]
                thick = float(np.ptp(centered @ thinnest_axis)) > CONFIG.thinnest
            else:
                thick = False
            part.corners, part.cut = left if thick else left[:0], True


def _measure_sideways_if_beside(parts: Sequence[_Part], overlap: _Overlap) -> _Overlap:
    """The overlap, measured sideways where neither object lies on the other.

    The shortest way out of a thin floor is up. An object beside it, as low as that floor, would lose its underside to
    that cut, and fall.
    """
    up = 1 if overlap.normal[2] > 0 else -1
    below, above = (parts[number] for number in overlap.parts[::up])
    lies_on = above.corners[:, 2].min() > below.corners[:, 2].min() + CONFIG.deep
    if abs(overlap.normal[2]) < CONFIG.upright or lies_on:
        return overlap
    upper, lower = (
        np.concatenate([part.corners for part in parts if part.owner == owner]) for owner in (above.owner, below.owner)
    )
    centre_is_over_outline = (_SIDEWAYS @ upper.mean(axis=0) <= (lower @ _SIDEWAYS.T).max(axis=0)).all()
    if centre_is_over_outline:
        return overlap
    reach = (below.corners @ _SIDEWAYS.T).max(axis=0) - (above.corners @ _SIDEWAYS.T).min(axis=0)
    best = int(reach.argmin())
    middle = (below.corners @ _SIDEWAYS[best]).max() - reach[best] / 2
    return replace(overlap, depth=float(reach[best]), point=middle * _SIDEWAYS[best], normal=up * _SIDEWAYS[best])
