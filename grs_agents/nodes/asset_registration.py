"""Matched objects where the photo shows them, and what their assets do not explain of the segments."""

from collections.abc import Sequence

from grs_agents.nodes.services import Photo, Services
from grs_agents.perception import (
    CandidateRecord,
    DroppedCandidate,
    Registered,
    SceneObject,
    add_candidates,
    asset_surface_at,
    load_mask,
    register,
    residual_candidates,
)
from grs_agents.perception.types import reachable


def register_assets(
    objects: Sequence[SceneObject], records: Sequence[CandidateRecord], photo: Photo, services: Services
) -> tuple[SceneObject, ...]:
    """The objects with the assets that were matched where the photo shows them."""
    (frame, table), library = photo, services.library
    by_number = {item.id: item for item in records}
    placed: list[SceneObject] = []
    for item in objects:
        update: dict[str, object] = {}
        if item.matched:
            mask = load_mask(services.folder / item.mask)
            registered = register(item.asset, library, by_number[item.id].upright, frame, table, mask)
            update = pose_fields(registered)
        placed.append(item.model_copy(update=update))
    return tuple(placed)


def pose_fields(registered: Registered) -> dict[str, object]:
    """What registration says of an object."""
    return {
        "position": registered.position,
        "orientation": registered.orientation,
        "size": registered.size,
        "reachable": reachable(registered.position),
        "method": registered.method,
        "residual": registered.residual,
        "round": registered.round,
    }


def add_residual_candidates(
    objects: Sequence[SceneObject], records: Sequence[CandidateRecord], photo: Photo, services: Services
) -> tuple[tuple[CandidateRecord, ...], tuple[DroppedCandidate, ...]]:
    """Residual candidates, which no placed asset explains, and the objects whose segments they were part of."""
    if not objects:
        return (), ()
    (frame, table), library = photo, services.library
    masks = [load_mask(services.folder / item.mask) for item in objects]
    shells = [
        asset_surface_at(item.asset, (item.position, item.orientation), library) if item.matched else None
        for item in objects
    ]
    residual = residual_candidates(masks, shells, frame, table, max(item.id for item in records) + 1)
    added = add_candidates(frame, residual.candidates, records, services.folder) if residual.candidates else ()
    return added, tuple(
        DroppedCandidate(id=objects[index].id, reason="much of it belongs to known things; the rest is looked at again")
        for index in residual.divided
    )
