"""Objects without an asset stand clear of others, and steadily: on the colliders of their shape, else of its box.

What would sink a little as it comes to rest reaches down to what carries it: nobody saw its underside.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from grs_agents.base.geometry.transforms import matrix_to_quaternion, pose_matrix, to_vec3
from grs_agents.library.library import Library
from grs_agents.library.shapes import matrix_from_quaternion
from grs_agents.perception.configuration import DEFAULT
from grs_agents.perception.proxies.primitive_proxy import Proxy, primitive_proxy
from grs_agents.perception.proxies.proxy_writer import write_proxy
from grs_agents.perception.settling.collider_clearance import PlacedColliders, Rank, clear_colliders, colliders_of_asset
from grs_agents.perception.settling.settling import Placed, PlacedObject, RestState, to_instance_objects
from grs_agents.perception.settling.twin_report import settle_and_measure_fidelity
from grs_agents.perception.shapes.colliders import lower_underside
from grs_agents.perception.shapes.view import object_pose
from grs_agents.perception.types import Mask, RGBDFrame, Solid, TableFrame, TwinReport, UprightBox

CONFIG = DEFAULT.settling.clearance


def extend_box_to_support(box: UprightBox) -> UprightBox:
    """A measured box that reaches into what is below it: what the one is in the other is cut off both.

    Its underside was cut on a grid, and what carries it may be flatter than it was seen.
    """
    (x, y, z), (length, width, height) = box.center, box.size
    lower = min(max(z - height / 2, 0.0), CONFIG.hovers)
    return box.model_copy(update={"center": (x, y, z - lower / 2), "size": (length, width, height + lower)})


@dataclass(frozen=True, eq=False)
class UnknownObject:
    """An object without an asset, and what stands for it in the frame of its box."""

    name: str  # of its proxy
    description: str
    solid: Solid  # which its box is filled with
    box: UprightBox
    proxy: Proxy


Thing = PlacedObject | UnknownObject


@dataclass(frozen=True)
class SteadyScene:
    """Objects as they are placed, the same at rest, and figures of that."""

    placed: list[PlacedObject]
    rest: RestState
    twin: TwinReport


def place_with_cleared_colliders(things: Sequence[Thing], folder: Path, library: Library) -> list[PlacedObject]:
    """Things where they stand; the proxies are written into ``folder``, with colliders clear of all others.

    Raises:
        InputError: the folder cannot be written.
    """
    cleared = _clear_colliders_of_things(things, library)
    return [_write_proxy_of_object(one, folder) if isinstance(one, UnknownObject) else one for one in cleared]


def _clear_colliders_of_things(things: Sequence[Thing], library: Library) -> list[Thing]:
    """The things, those without an asset with colliders clear of all others."""
    placed = [
        PlacedColliders(one.proxy.colliders, object_pose(one.box), Rank.HOLLOW if one.proxy.hollow else Rank.SOLID)
        if isinstance(one, UnknownObject)
        else PlacedColliders(colliders_of_asset(one.asset, library), _asset_pose(one, library), Rank.ASSET)
        for one in things
    ]
    return [
        replace(one, proxy=replace(one.proxy, colliders=colliders)) if isinstance(one, UnknownObject) else one
        for one, colliders in zip(things, clear_colliders(placed), strict=True)
    ]


def settle_with_stable_colliders(
    things: Sequence[Thing],
    folder: Path,
    library: Callable[[], Library],
    frame: RGBDFrame,
    table: TableFrame,
    mask: Mask,
) -> SteadyScene:
    """Write the proxies of things, and let all come to rest.

    What sinks is lengthened down to what carries it; what else does not stay where it was has primitive colliders.

    Args:
        folder: the library of the run, into which proxies are written.
        library: reads the library with what is in that folder by now.
        mask: (H, W) pixels at which the twin is compared with the photo.

    Raises:
        SimulationError: MuJoCo takes the scene for impossible.
    """

    def place_and_settle(things: Sequence[Thing]) -> SteadyScene:
        placed = place_with_cleared_colliders(things, folder, library())
        return SteadyScene(placed, *settle_and_measure_fidelity(placed, library(), frame, table, mask))

    first = place_and_settle(things)
    unsteady = [*map(_is_proxy_unstable, things, first.placed, first.rest.placed)]
    if not any(unsteady):
        return first
    cleared = _clear_colliders_of_things(things, library())
    ends = zip(things, cleared, unsteady, first.placed, first.rest.placed, strict=True)
    second = place_and_settle(
        [_make_stable(one, clear, placed, end) if moved else one for one, clear, moved, placed, end in ends]
    )
    if sum(map(_is_proxy_unstable, things, second.placed, second.rest.placed)) < sum(unsteady):
        return second
    place_with_cleared_colliders(things, folder, library())
    return first


def _write_proxy_of_object(one: UnknownObject, folder: Path) -> PlacedObject:
    """Write the proxy of an object."""
    asset = write_proxy(folder, one.name, one.proxy, one.description)
    pose = object_pose(one.box)
    position = to_vec3(pose[:3, :3] @ one.proxy.center + pose[:3, 3])
    return PlacedObject(asset.name, (position, matrix_to_quaternion(pose[:3, :3])), guessed=True)


def _asset_pose(one: PlacedObject, library: Library) -> "np.ndarray[tuple[int, ...], np.dtype[np.float64]]":
    """(4, 4) transform from the frame of an object's asset to the robot frame, m."""
    (instance,) = to_instance_objects([one], library)
    position, turn = instance.pose
    return pose_matrix(matrix_from_quaternion(turn), np.array(position))


def _make_stable(one: Thing, cleared: Thing, placed: PlacedObject, end: Placed | None) -> Thing:
    """An object whose shape is only seen: lengthened down if it sank straight, else on its box or cylinder.

    Args:
        cleared: the object with the colliders with which it was placed, and came to its ``end``.
    """
    if not (isinstance(one, UnknownObject) and isinstance(cleared, UnknownObject)):
        return one
    if end is not None and _sank_straight(placed, end):
        longer = lower_underside(cleared.proxy.colliders, placed.pose[0][2] - end.pose[0][2])
        return replace(one, proxy=replace(one.proxy, colliders=longer))
    primitive = primitive_proxy(one.solid, one.box.size, one.proxy.color, one.proxy.hollow)
    return replace(one, proxy=replace(one.proxy, colliders=primitive.colliders))


def _is_proxy_unstable(thing: Thing, one: PlacedObject, end: Placed | None) -> bool:
    """Whether an object without an asset does not stay by itself where the photo shows it."""
    if not isinstance(thing, UnknownObject) or end is None:
        return False
    moved = end.drift > CONFIG.moved or _tilt(one, end) > CONFIG.tilted
    on_table = thing.box.center[2] - thing.box.size[2] / 2 < CONFIG.hovers
    return moved or (end.held and on_table)


def _sank_straight(one: PlacedObject, end: Placed) -> bool:
    """Whether it was only lower at rest."""
    aside = float(np.hypot(*np.subtract(end.pose[0], one.pose[0])[:2]))
    return end.pose[0][2] < one.pose[0][2] and aside < CONFIG.aside and _tilt(one, end) < CONFIG.tilted


def _tilt(one: PlacedObject, end: Placed) -> float:
    """By how much it tilted until it rested, radians."""
    upright = float(matrix_from_quaternion(one.pose[1])[2] @ matrix_from_quaternion(end.pose[1])[2])
    return float(np.arccos(min(upright, 1.0)))
