"""Objects as they stand to each other: apart, without those that are pieces of others, related, settled in the twin."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from grs_agents.base.errors import GrsError
from grs_agents.graph.scene_object_building import (
    describe_size_mismatch,
    reconstruct_proxy,
    replace_by_proxy,
)
from grs_agents.graph.services import Photo, Services
from grs_agents.library.library import Library
from grs_agents.perception.picture_files import load_mask
from grs_agents.perception.registration.scene_registration import registered_object_fields
from grs_agents.perception.registration.size_check import enclosing_aabb
from grs_agents.perception.settling.collision_repair import KnownObject, repair_collisions
from grs_agents.perception.settling.proxy_placement import (
    UnknownObject,
    extend_box_to_support,
    place_with_cleared_colliders,
    settle_with_stable_colliders,
)
from grs_agents.perception.settling.segment_reconciliation import Reconciled, Segment, reconcile_segments
from grs_agents.perception.settling.settling import Placed, PlacedObject
from grs_agents.perception.settling.support_relations import body_from_asset, find_spatial_relations
from grs_agents.perception.types import (
    CandidateRecord,
    DroppedCandidate,
    Mask,
    Relation,
    RGBDFrame,
    SceneObject,
    TableFrame,
    TwinReport,
    is_reachable_position,
)
from grs_agents.sim.instance.episode import SimulationError


@dataclass(frozen=True)
class SettledScene:
    """The objects where they stand, how they lie to each other, their twin, and what a reader should know.

    ``dropped`` are those that turned out to be pieces of others, or no objects. ``owned`` (H, W) are the pixels of all
    objects, None where there is none.
    """

    objects: tuple[SceneObject, ...]
    relations: tuple[Relation, ...] = ()
    twin: TwinReport | None = None
    warnings: tuple[str, ...] = ()
    dropped: tuple[DroppedCandidate, ...] = ()
    owned: Mask | None = None


@dataclass(frozen=True)
class _Scene:
    """What the objects were seen in: the photo and its pose, and the candidates that they come from, by number.

    ``above`` (H, W) is what rises above the table.
    """

    frame: RGBDFrame
    table: TableFrame
    above: Mask
    records: Mapping[int, CandidateRecord]
    services: Services

    def load_object_mask(self, item: SceneObject) -> Mask:
        """The pixels (H, W) of an object."""
        return load_mask(self.services.folder / item.mask)


def settle_scene(
    objects: Sequence[SceneObject], records: Sequence[CandidateRecord], photo: Photo, above: Mask, services: Services
) -> SettledScene:
    """Tell pieces of others and relations, fit the proxies, and settle the twin; what MuJoCo refuses has none.

    The twin is compared with the photo where that shows something ``above`` the table (H, W).
    """
    if not objects:
        return SettledScene(())
    scene = _Scene(*photo, above, {record.id: record for record in records}, services)
    separated, dropped, warnings = tuple(objects), list[DroppedCandidate](), tuple[str, ...]()
    try:
        separated, dropped = _resolve_collisions(objects, scene)
    except SimulationError as error:
        warnings = (f"objects that stand in each other stay there: {error.message}",)
    settled = _reconcile_and_settle(separated, scene)
    return replace(settled, warnings=(*warnings, *settled.warnings), dropped=(*dropped, *settled.dropped))


def _resolve_collisions(
    objects: Sequence[SceneObject], scene: _Scene
) -> tuple[tuple[SceneObject, ...], list[DroppedCandidate]]:
    """The objects, those that were registered into others beside them, if that still agrees with what was measured.

    One that can be nowhere else has a proxy instead of its asset, or is told among those that are none.
    """
    matched = [index for index, item in enumerate(objects) if item.matched]
    known_objects = [
        KnownObject(_to_placed_object(item), scene.records[item.id].upright, scene.load_object_mask(item))
        for item in (objects[index] for index in matched)
    ]
    placed: dict[int, SceneObject] = dict(enumerate(objects))
    dropped: list[DroppedCandidate] = []
    collisions = repair_collisions(known_objects, scene.frame, scene.table, scene.services.library)
    for index, registered in collisions.moved.items():
        item = objects[matched[index]].model_copy(update=registered_object_fields(registered))
        if not describe_size_mismatch(item, scene.services):
            placed[matched[index]] = item
    for index in sorted(collisions.wrong):
        item, names = placed.pop(matched[index]), [other.name for other in (*objects, *placed.values())]
        photo, why = (scene.frame, scene.table), "it stands in another thing"
        replacement = replace_by_proxy(item, why, scene.records[item.id], names, photo, scene.services)
        if isinstance(replacement, DroppedCandidate):
            dropped.append(replacement)
        else:
            placed[matched[index]] = replacement
    return tuple(placed[index] for index in sorted(placed)), dropped


def _reconcile_and_settle(objects: Sequence[SceneObject], scene: _Scene) -> SettledScene:
    """The objects at rest, without those that are pieces of others."""
    segments: list[Segment] = []
    for item in objects:
        record, known = scene.records[item.id], _to_placed_object(item) if item.matched else None
        mask = scene.load_object_mask(item)
        segments.append(Segment(mask, record.upright, record.shape, known, record.hollow, record.given))
    agreed = reconcile_segments(segments, scene.frame, scene.table, scene.services.library)
    kept = [index for index in range(len(objects)) if index not in agreed.pieces]
    dropped = tuple(
        DroppedCandidate(id=objects[piece].id, reason=f"a piece of {objects[whole].name}")
        for piece, whole in agreed.pieces.items()
    )
    mask = np.any([segment.mask for segment in segments], axis=0)
    seen = [_set_box_cleared_of_neighbors(objects[index], index, agreed, scene) for index in kept]
    things = [
        _place_asset_or_reconstruct_proxy(item, index, segments[index].mask, agreed, scene)
        for item, index in zip(seen, kept, strict=True)
    ]
    return replace(_simulate_to_rest(seen, things, mask, scene), dropped=dropped, owned=mask)


def _set_box_cleared_of_neighbors(item: SceneObject, index: int, agreed: Reconciled, scene: _Scene) -> SceneObject:
    """An object; one without an asset with the box that its neighbours leave it."""
    claim = agreed.claims.get(index)
    if claim is None:
        return item
    measured = claim.measured_box(scene.records[item.id].upright)
    return item.model_copy(update={"box": enclosing_aabb(measured, claim.shape), "upright": measured})


def _place_asset_or_reconstruct_proxy(
    item: SceneObject, index: int, mask: Mask, agreed: Reconciled, scene: _Scene
) -> PlacedObject | UnknownObject:
    """What stands for an object: its asset, or the shape that is reconstructed of it."""
    claim, record = agreed.claims.get(index), scene.records[item.id]
    if claim is None:
        return _to_placed_object(item)
    box, photo = extend_box_to_support(claim.box), (scene.frame, scene.table)
    proxy = reconstruct_proxy(record, box, claim.shape, mask, photo, scene.services)
    return UnknownObject(item.name, item.description, claim.shape, box, proxy)


def _simulate_to_rest(
    objects: Sequence[SceneObject], things: Sequence[PlacedObject | UnknownObject], owned: Mask, scene: _Scene
) -> SettledScene:
    """The objects where they come to rest in MuJoCo.

    The twin is compared with the photo at the ``owned`` pixels (H, W) and at all others above the table.
    """
    services, folder, warnings = scene.services, scene.services.folder / "assets", tuple[str, ...]()
    ends: Sequence[Placed | None] = [None] * len(objects)
    twin: TwinReport | None = None
    try:
        above = scene.above | owned
        steady = settle_with_stable_colliders(things, folder, lambda: services.library, scene.frame, scene.table, above)
        placed, ends, twin = steady.placed, steady.rest.placed, steady.twin
    except GrsError as error:
        placed, warnings = (
            place_with_cleared_colliders(things, folder, services.library),
            (f"the scene has no twin: {error.message}",),
        )
    library = services.library  # with the proxies that were written
    resting = tuple(map(partial(_set_rest_pose, library), objects, placed, ends))
    bodies = [body_from_asset(item.name, item.asset, (item.position, item.orientation), library) for item in resting]
    return SettledScene(resting, find_spatial_relations(bodies), twin, warnings)


def _set_rest_pose(library: Library, item: SceneObject, placed: PlacedObject, end: Placed | None) -> SceneObject:
    """An object as it is placed, and where it comes to rest, if that is known."""
    update: dict[str, object] = {"settled": end.pose, "drift": end.drift, "held": end.held} if end else {}
    if placed.guessed:
        position, orientation = placed.pose
        update |= {"position": position, "orientation": orientation, "size": library.asset(placed.asset).size}
        update |= {"reachable": is_reachable_position(position)}
    return item.model_copy(update=update)


def _to_placed_object(item: SceneObject) -> PlacedObject:
    return PlacedObject(item.asset, (item.position, item.orientation), guessed=not item.matched)
