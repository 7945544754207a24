"""The matched objects of a scene where the photo shows them, and what their assets do not explain of the segments."""

from collections.abc import Sequence
from pathlib import Path

from grs_agents.library.library import Library
from grs_agents.perception.asset_surfaces import asset_surface_at_pose
from grs_agents.perception.picture_files import load_mask, save_candidates_after_earlier
from grs_agents.perception.registration.registration import Registered, register_asset
from grs_agents.perception.registration.unexplained_segments import find_residual_candidates
from grs_agents.perception.types import (
    CandidateRecord,
    DroppedCandidate,
    RGBDFrame,
    SceneObject,
    TableFrame,
    is_reachable_position,
)


def register_objects(
    objects: Sequence[SceneObject],
    records: Sequence[CandidateRecord],
    frame: RGBDFrame,
    table: TableFrame,
    library: Library,
    folder: Path,
) -> tuple[SceneObject, ...]:
    """The objects, those with a matched asset at the pose in which it explains the points of their segments.
    Proxies stay where their boxes put them. ``folder`` is the run folder, which holds the masks."""
    by_number = {record.id: record for record in records}
    placed: list[SceneObject] = []
    for item in objects:
        update: dict[str, object] = {}
        if item.matched:
            mask = load_mask(folder / item.mask)
            found = register_asset(item.asset, library, by_number[item.id].upright, frame, table, mask)
            update = registered_object_fields(found)
        placed.append(item.model_copy(update=update))
    return tuple(placed)


def registered_object_fields(registered: Registered) -> dict[str, object]:
    """The fields of a ``SceneObject`` that registration sets."""
    placed = {"position": registered.position, "orientation": registered.orientation, "size": registered.size}
    fit = {"method": registered.method, "residual": registered.residual, "round": registered.round}
    return {**placed, **fit, "reachable": is_reachable_position(registered.position)}


def add_residual_candidates(
    objects: Sequence[SceneObject],
    records: Sequence[CandidateRecord],
    frame: RGBDFrame,
    table: TableFrame,
    library: Library,
    folder: Path,
) -> tuple[tuple[CandidateRecord, ...], tuple[DroppedCandidate, ...]]:
    """Residual candidates, which no placed asset explains, and the objects whose segments they were part of.
    Their masks and crops are written into ``folder``; the objects are registered. Given masks are not divided."""
    if not objects or all(record.given for record in records):
        return (), ()
    masks = [load_mask(folder / item.mask) for item in objects]
    surfaces = [
        asset_surface_at_pose(item.asset, (item.position, item.orientation), library) if item.matched else None
        for item in objects
    ]
    residual = find_residual_candidates(masks, surfaces, frame, table, max(record.id for record in records) + 1)
    added = save_candidates_after_earlier(frame, residual.candidates, records, folder) if residual.candidates else ()
    reason = "much of it belongs to known things; the rest is looked at again"
    return added, tuple(DroppedCandidate(id=objects[index].id, reason=reason) for index in residual.divided)
