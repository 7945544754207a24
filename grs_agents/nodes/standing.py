"""From objects laid into boxes to objects where the photo shows them: registered, related, and settled in the twin."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from grs_agents.correspondence.heights import crowded
from grs_agents.errors import GrsError
from grs_agents.library import Library
from grs_agents.nodes.fitting import given_way, unlike
from grs_agents.nodes.matching import about_z, write_stand_in
from grs_agents.nodes.services import Services
from grs_agents.scene import (
    Camera,
    CandidateRecord,
    DroppedCandidate,
    Mask,
    Registered,
    Relation,
    RGBDFrame,
    SceneObject,
    TableFrame,
    TwinReport,
    add_candidates,
    aligned,
    body_of,
    found_later,
    load_frame,
    load_mask,
    register,
    relations,
    shell_of,
)
from grs_agents.sim.episode import SimulationError
from grs_agents.state import RunState
from grs_agents.twin import Known, Segment, Thing, disentangled, reconcile, report_of
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
    """Tell pieces of others and relations, fit the proxies, and settle the twin; what MuJoCo refuses has none.

    Args:
        objects: registered.
        records: the candidates that they come from.
        state, services: of the run.

    Raises:
        InputError: the pictures that the comprehension wrote are gone.
    """
    if not objects:
        return Stood(())
    table = TableFrame.model_validate(state["frame"])
    frame = load_frame(services.folder, Camera.model_validate(state["camera"]), state["scene_path"])
    by_number = {one.id: one for one in records}
    apart, gone, warnings = tuple(objects), list[DroppedCandidate](), tuple[str, ...]()
    try:
        apart, gone = _apart(objects, by_number, frame, table, services)
    except SimulationError as error:
        warnings = (f"objects that stand in each other stay there: {error.message}",)
    placed, dropped = _agreed(apart, by_number, frame, table, services)
    library = services.library  # with the proxies that were written again
    bodies = [body_of(one.name, one.asset, (one.position, one.orientation), library) for one in placed]
    stood = Stood(placed, relations(bodies), warnings=warnings, dropped=(*gone, *dropped))
    try:
        mask = np.any([load_mask(services.folder / one.mask) for one in objects], axis=0)
        return _settled(stood, frame, table, mask, library)
    except GrsError as error:
        return replace(stood, warnings=(*warnings, f"the scene has no twin: {error.message}"))


def registered(
    objects: Sequence[SceneObject], records: Sequence[CandidateRecord], state: RunState, services: Services
) -> tuple[SceneObject, ...]:
    """The objects with the assets that were matched where the photo shows them.

    Raises:
        InputError: the pictures that the comprehension wrote are gone.
    """
    table, library = TableFrame.model_validate(state["frame"]), services.library
    frame = load_frame(services.folder, Camera.model_validate(state["camera"]), state["scene_path"])
    by_number = {one.id: one for one in records}
    placed: list[SceneObject] = []
    for one in objects:
        update: dict[str, object] = {}
        if one.matched:
            mask = load_mask(services.folder / one.mask)
            found = register(one.asset, library, by_number[one.id].upright, frame, table, mask)
            update = _standing_at(found)
        placed.append(one.model_copy(update=update))
    return tuple(placed)


def _standing_at(found: Registered) -> dict[str, object]:
    """What registration says of an object."""
    return {
        "position": found.position,
        "orientation": found.orientation,
        "size": found.size,
        "reachable": reachable(found.position),
        "method": found.method,
        "residual": found.residual,
        "round": found.round,
    }


def _apart(
    objects: Sequence[SceneObject],
    records: Mapping[int, CandidateRecord],
    frame: RGBDFrame,
    table: TableFrame,
    services: Services,
) -> tuple[tuple[SceneObject, ...], list[DroppedCandidate]]:
    """The objects, those that were registered into others beside them, if that still agrees with what was measured.

    One that can be nowhere else has a proxy instead of its asset, or is told among those that are none.
    """
    known = [index for index, one in enumerate(objects) if one.matched]
    things = [
        Known(_thing(one), records[one.id].upright, load_mask(services.folder / one.mask))
        for one in (objects[index] for index in known)
    ]
    placed: dict[int, SceneObject] = dict(enumerate(objects))
    lost: list[DroppedCandidate] = []
    found = disentangled(things, frame, table, services.library)
    for index, stood in found.moved.items():
        one = objects[known[index]].model_copy(update=_standing_at(stood))
        if not unlike(one, services):
            placed[known[index]] = one
    for index in sorted(found.wrong):
        one, names = placed.pop(known[index]), [other.name for other in (*objects, *placed.values())]
        stand_in = given_way(one, "it stands in another thing", records[one.id], names, (frame, table), services)
        if isinstance(stand_in, DroppedCandidate):
            lost.append(stand_in)
        else:
            placed[known[index]] = stand_in
    return tuple(placed[index] for index in sorted(placed)), lost


def seen_later(
    objects: Sequence[SceneObject], records: Sequence[CandidateRecord], state: RunState, services: Services
) -> tuple[tuple[CandidateRecord, ...], tuple[DroppedCandidate, ...]]:
    """Candidates that were taken for parts of others, once assets stand; and those that are only these and known ones.

    Raises:
        InputError: the pictures that the comprehension wrote are gone.
    """
    if not objects:
        return (), ()
    table, library = TableFrame.model_validate(state["frame"]), services.library
    frame = load_frame(services.folder, Camera.model_validate(state["camera"]), state["scene_path"])
    masks = [load_mask(services.folder / one.mask) for one in objects]
    shells = [shell_of(one.asset, (one.position, one.orientation), library) if one.matched else None for one in objects]
    found = found_later(masks, shells, frame, table, max(one.id for one in records) + 1)
    added = add_candidates(frame, found.candidates, records, services.folder) if found.candidates else ()
    return added, tuple(
        DroppedCandidate(id=objects[index].id, reason="much of it belongs to known things; the rest is looked at again")
        for index in found.divided
    )


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
            _thing(one) if one.matched else None,
            records[one.id].hollow,
        )
        for one in objects
    ]
    agreed = reconcile(segments, frame, table, services.library)
    kept: list[SceneObject] = []
    for index, one in enumerate(objects):
        claim, around = agreed.claims.get(index), agreed.around(index)
        if claim is not None and (claim.box != records[one.id].upright or crowded(claim.box, around)):
            photo, words, measured = (frame, table), one.description, claim.measured(records[one.id].upright)
            asset = write_stand_in(one.name, records[one.id], claim.box, claim.shape, words, services, photo, around)
            update = {"position": claim.box.center, "orientation": about_z(claim.box.yaw), "size": asset.size,
                      "box": aligned(measured, claim.shape), "upright": measured}  # fmt: skip
            kept.append(one.model_copy(update={**update, "reachable": reachable(claim.box.center)}))
        elif index not in agreed.pieces:
            kept.append(one)
    dropped = tuple(
        DroppedCandidate(id=objects[piece].id, reason=f"a piece of {objects[whole].name}")
        for piece, whole in agreed.pieces.items()
    )
    return tuple(kept), dropped


def _thing(one: SceneObject) -> Thing:
    return Thing(one.asset, (one.position, one.orientation), guessed=not one.matched)


def _settled(stood: Stood, frame: RGBDFrame, table: TableFrame, mask: Mask, library: Library) -> Stood:
    things = [_thing(one) for one in stood.objects]
    rest, twin = report_of(things, library, frame, table, mask)
    objects = tuple(
        one if placed is None else one.model_copy(update={"settled": placed.pose, "drift": placed.drift})
        for one, placed in zip(stood.objects, rest.placed, strict=True)
    )
    return replace(stood, objects=objects, twin=twin)
