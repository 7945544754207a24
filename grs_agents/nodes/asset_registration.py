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
    by_number = {one.id: one for one in records}
    placed: list[SceneObject] = []
    for one in objects:
        update: dict[str, object] = {}
        if one.matched:
            mask = load_mask(services.folder / one.mask)
            found = register(one.asset, library, by_number[one.id].upright, frame, table, mask)
            update = standing_at(found)
        placed.append(one.model_copy(update=update))
    return tuple(placed)


def standing_at(found: Registered) -> dict[str, object]:
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


def add_residual_candidates(
    objects: Sequence[SceneObject], records: Sequence[CandidateRecord], photo: Photo, services: Services
) -> tuple[tuple[CandidateRecord, ...], tuple[DroppedCandidate, ...]]:
    """Residual candidates, which no placed asset explains, and the objects whose segments they were part of."""
    if not objects:
        return (), ()
    (frame, table), library = photo, services.library
    masks = [load_mask(services.folder / one.mask) for one in objects]
    shells = [
        asset_surface_at(one.asset, (one.position, one.orientation), library) if one.matched else None
        for one in objects
    ]
    found = residual_candidates(masks, shells, frame, table, max(one.id for one in records) + 1)
    added = add_candidates(frame, found.candidates, records, services.folder) if found.candidates else ()
    return added, tuple(
        DroppedCandidate(id=objects[index].id, reason="much of it belongs to known things; the rest is looked at again")
        for index in found.divided
    )
