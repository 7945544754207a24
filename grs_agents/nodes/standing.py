"""From objects laid into boxes to objects where the photo shows them: registered, related, and settled in the twin."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from grs_agents.errors import GrsError
from grs_agents.library import Library
from grs_agents.nodes.matching import about_z, write_stand_in
from grs_agents.nodes.services import Services
from grs_agents.scene import (
    Camera,
    CandidateRecord,
    DroppedCandidate,
    Mask,
    Relation,
    RGBDFrame,
    SceneObject,
    TableFrame,
    TwinReport,
    body_of,
    load_frame,
    load_mask,
    register,
    relations,
)
from grs_agents.state import RunState
from grs_agents.twin import Segment, Thing, reconcile, report_of
from grs_agents.workspace import reachable


@dataclass(frozen=True)
class Stood:
    """The objects where they stand, how they lie to each other, their twin, and what a reader should know.

    ``dropped`` are those that turned out to be pieces of others.
    """

    objects: tuple[SceneObject, ...]
    relations: tuple[Relation, ...] = ()
    twin: TwinReport | None = None
    warnings: tuple[str, ...] = ()
    dropped: tuple[DroppedCandidate, ...] = ()


def stand(
    objects: Sequence[SceneObject], records: Sequence[CandidateRecord], state: RunState, services: Services
) -> Stood:
    """Register what was matched, tell the relations, and settle the twin; what MuJoCo refuses has none.

    Raises:
        InputError: the pictures that the comprehension wrote are gone.
    """
    if not objects:
        return Stood(())
    table, library = TableFrame.model_validate(state["frame"]), services.library
    frame = load_frame(services.folder, Camera.model_validate(state["camera"]), state["scene_path"])
    by_number = {one.id: one for one in records}
    placed = tuple(_registered(one, by_number[one.id], frame, table, services, library) for one in objects)
    placed, dropped = _agreed(placed, by_number, frame, table, services)
    library = services.library  # with the proxies that were written again
    bodies = [body_of(one.name, one.asset, (one.position, one.orientation), library) for one in placed]
    stood = Stood(placed, relations(bodies), dropped=dropped)
    try:
        mask = np.any([load_mask(services.folder / one.mask) for one in objects], axis=0)
        return _settled(stood, frame, table, mask, library)
    except GrsError as error:
        return replace(stood, warnings=(f"the scene has no twin: {error.message}",))


def _registered(
    one: SceneObject, record: CandidateRecord, frame: RGBDFrame, table: TableFrame, services: Services, library: Library
) -> SceneObject:
    if not one.matched:
        return one
    found = register(one.asset, library, record.upright, frame, table, load_mask(services.folder / record.mask))
    update = {
        "position": found.position,
        "orientation": found.orientation,
        "size": found.size,
        "reachable": reachable(found.position),
        "method": found.method,
        "residual": found.residual,
        "round": found.round,
    }
    return one.model_copy(update=update)


def _agreed(
    objects: Sequence[SceneObject],
    records: Mapping[int, CandidateRecord],
    frame: RGBDFrame,
    table: TableFrame,
    services: Services,
) -> tuple[tuple[SceneObject, ...], tuple[DroppedCandidate, ...]]:
    """The objects without those that are pieces of others, their proxies within the space that is left for them."""
    segments = [
        Segment(
            load_mask(services.folder / one.mask),
            records[one.id].upright,
            records[one.id].shape,
            Thing(one.asset, (one.position, one.orientation)) if one.matched else None,
        )
        for one in objects
    ]
    agreed = reconcile(segments, frame, table, services.library)
    kept: list[SceneObject] = []
    for index, one in enumerate(objects):
        claim = agreed.claims.get(index)
        if claim is not None and claim.box != records[one.id].upright:
            asset = write_stand_in(one.name, records[one.id], claim.box, claim.shape, one.description, services)
            update = {"position": claim.box.center, "orientation": about_z(claim.box.yaw), "size": asset.size}
            kept.append(one.model_copy(update={**update, "reachable": reachable(claim.box.center)}))
        elif index not in agreed.pieces:
            kept.append(one)
    dropped = tuple(
        DroppedCandidate(id=objects[piece].id, reason=f"a piece of {objects[whole].name}")
        for piece, whole in agreed.pieces.items()
    )
    return tuple(kept), dropped


def _settled(stood: Stood, frame: RGBDFrame, table: TableFrame, mask: Mask, library: Library) -> Stood:
    things = [Thing(one.asset, (one.position, one.orientation)) for one in stood.objects]
    rest, twin = report_of(things, library, frame, table, mask)
    objects = tuple(
        one if placed is None else one.model_copy(update={"settled": placed.pose, "drift": placed.drift})
        for one, placed in zip(stood.objects, rest.placed, strict=True)
    )
    return replace(stood, objects=objects, twin=twin)
