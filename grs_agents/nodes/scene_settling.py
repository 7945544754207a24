"""Objects as they stand to each other: apart, without those that are pieces of others, related, settled in the twin."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from grs_agents.errors import GrsError
from grs_agents.nodes.scene_objects import (
    describe_size_mismatch,
    replace_by_proxy,
    write_measured_proxy,
    yaw_quaternion,
)
from grs_agents.nodes.services import Photo, Services
from grs_agents.perception import (
    CandidateRecord,
    DroppedCandidate,
    Mask,
    Relation,
    RGBDFrame,
    SceneObject,
    TableFrame,
    TwinReport,
    body_from_asset,
    enclosing_aabb,
    find_spatial_relations,
    is_reachable_position,
    load_mask,
    registered_object_fields,
)
from grs_agents.perception.proxies import is_box_crowded
from grs_agents.perception.settling import (
    KnownObject,
    PlacedObject,
    Reconciled,
    Segment,
    match_fallen_to_support,
    reconcile_segments,
    repair_collisions,
    settle_and_report,
)
from grs_agents.sim.instance import SimulationError


@dataclass(frozen=True)
class SettledScene:
    """The objects where they stand, how they lie to each other, their twin, and what a reader should know.

    ``dropped`` are those that turned out to be pieces of others, or no objects.
    """

    objects: tuple[SceneObject, ...]
    relations: tuple[Relation, ...] = ()
    twin: TwinReport | None = None
    warnings: tuple[str, ...] = ()
    dropped: tuple[DroppedCandidate, ...] = ()


@dataclass(frozen=True)
class _Scene:
    """What the objects were seen in: the photo and its pose, and the candidates that they come from, by number."""

    frame: RGBDFrame
    table: TableFrame
    records: Mapping[int, CandidateRecord]
    services: Services

    def load_object_mask(self, item: SceneObject) -> Mask:
        """The pixels (H, W) of an object."""
        return load_mask(self.services.folder / item.mask)


def settle_scene(
    objects: Sequence[SceneObject], records: Sequence[CandidateRecord], photo: Photo, services: Services
) -> SettledScene:
    """Tell pieces of others and relations, fit the proxies, and settle the twin; what MuJoCo refuses has none."""
    if not objects:
        return SettledScene(())
    scene = _Scene(*photo, {record.id: record for record in records}, services)
    separated, dropped, warnings = tuple(objects), list[DroppedCandidate](), tuple[str, ...]()
    try:
        separated, dropped = _resolve_collisions(objects, scene)
    except SimulationError as error:
        warnings = (f"objects that stand in each other stay there: {error.message}",)
    settled, carried = _reconcile_and_settle(separated, {}, scene)
    if carried:
        settled, _ = _reconcile_and_settle(separated, carried, scene)
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


def _reconcile_and_settle(
    objects: Sequence[SceneObject], united: Mapping[int, int], scene: _Scene
) -> tuple[SettledScene, dict[int, int]]:
    """The objects at rest, without those that are pieces of others; and which of them are carried by which, by index.

    ``united`` are pieces of others, by index.
    """
    segments: list[Segment] = []
    for item in objects:
        record, placed_item = scene.records[item.id], _to_placed_object(item) if item.matched else None
        segments.append(Segment(scene.load_object_mask(item), record.upright, record.shape, placed_item, record.hollow))
    agreed = reconcile_segments(segments, scene.frame, scene.table, scene.services.library, united)
    kept = [index for index in range(len(objects)) if index not in agreed.pieces]
    placed = [_refit_proxy(objects[index], index, agreed, scene, bool(united)) for index in kept]
    dropped = tuple(
        DroppedCandidate(id=objects[piece].id, reason=f"a piece of {objects[whole].name}")
        for piece, whole in agreed.pieces.items()
    )
    mask = np.any([segment.mask for segment in segments], axis=0)
    settled, fallen = _simulate_to_rest(placed, mask, scene)
    return replace(settled, dropped=dropped), match_fallen_to_support({kept[index] for index in fallen}, agreed)


def _simulate_to_rest(objects: Sequence[SceneObject], mask: Mask, scene: _Scene) -> tuple[SettledScene, set[int]]:
    """The objects where they come to rest in MuJoCo, and the indices of those that fell.

    ``mask`` (H, W) are the pixels of all segments, at which the twin is compared with the photo.
    """
    library = scene.services.library  # with the proxies that were written again
    bodies = [body_from_asset(item.name, item.asset, (item.position, item.orientation), library) for item in objects]
    settled = SettledScene(tuple(objects), find_spatial_relations(bodies))
    try:
        rest, twin = settle_and_report(
            [_to_placed_object(item) for item in objects], library, scene.frame, scene.table, mask
        )
    except GrsError as error:
        return replace(settled, warnings=(f"the scene has no twin: {error.message}",)), set()
    resting = tuple(
        item if end is None else item.model_copy(update={"settled": end.pose, "drift": end.drift, "held": end.held})
        for item, end in zip(objects, rest.placed, strict=True)
    )
    fallen = {index for index, end in enumerate(rest.placed) if end is not None and end.fell}
    return replace(settled, objects=resting, twin=twin), fallen


def _refit_proxy(item: SceneObject, index: int, agreed: Reconciled, scene: _Scene, again: bool) -> SceneObject:
    """An object; its proxy, if it has one that does not fill the space that is left for it, written again.

    With ``again`` in any case: what was written before may have been for less space.
    """
    claim, record = agreed.claims.get(index), scene.records[item.id]
    if claim is None:
        return item
    around, mask = agreed.surroundings_of_segment(index), agreed.masks[index]
    fits = claim.box == record.upright and index not in agreed.pieces.values()
    if fits and not again and not is_box_crowded(claim.box, around):
        return item
    photo, measured = (scene.frame, scene.table), claim.measured_box(record.upright)
    asset = write_measured_proxy(
        item.name, record, claim.box, claim.shape, item.description, scene.services, photo, around, mask
    )
    return item.model_copy(
        update={
            "position": claim.box.center,
            "orientation": yaw_quaternion(claim.box.yaw),
            "size": asset.size,
            "box": enclosing_aabb(measured, claim.shape),
            "upright": measured,
            "reachable": is_reachable_position(claim.box.center),
        }
    )


def _to_placed_object(item: SceneObject) -> PlacedObject:
    return PlacedObject(item.asset, (item.position, item.orientation), guessed=not item.matched)
