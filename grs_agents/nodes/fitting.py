"""An asset that cannot be what was measured, where it was measured, gives way to a proxy of that size."""

from collections.abc import Mapping, Sequence

from grs_agents.agents import Description
from grs_agents.nodes.scene_objects import Matched, drop_reason, object_of
from grs_agents.nodes.services import Photo, Services
from grs_agents.perception import (
    CandidateRecord,
    DroppedCandidate,
    MatchEvidence,
    SceneObject,
    certain,
    deviation,
    upright_of,
)


def fitting(
    objects: Sequence[SceneObject],
    records: Mapping[int, CandidateRecord],
    taken: Sequence[str],
    photo: Photo,
    services: Services,
) -> tuple[tuple[SceneObject, ...], list[DroppedCandidate]]:
    """The objects, each with an asset or a proxy of its size, and those that have neither.

    Args:
        objects: registered.
        records: the candidates that they come from, by number.
        taken: names that other objects have.
        photo: the frame and its pose.
        services: of the run.
    """
    kept: list[SceneObject] = []
    lost: list[DroppedCandidate] = []
    for one in objects:
        why = unlike(one, services)
        names = [*taken, *(other.name for other in (*objects, *kept))]
        found = given_way(one, why, records[one.id], names, photo, services) if why else one
        if isinstance(found, DroppedCandidate):
            lost.append(found)
        else:
            kept.append(found)
    return tuple(kept), lost


def unlike(one: SceneObject, services: Services) -> str:
    """Why the asset of an object does not stand for what was measured of it; empty if it does, or is a proxy."""
    if not one.matched or certain(one):
        return ""
    off = deviation(one.asset, (one.position, one.orientation), services.library, one.upright or upright_of(one.box))
    return "" if off.agrees else f"is not of the measured size there: {off}"


def given_way(
    one: SceneObject,
    why: str,
    record: CandidateRecord,
    taken: Sequence[str],
    photo: Photo,
    services: Services,
) -> SceneObject | DroppedCandidate:
    """An object with a proxy instead of its asset; or, without proxies, why it is none.

    Args:
        one: the object.
        why: what is wrong with its asset.
        record: the candidate that it comes from.
        taken: names that other objects have.
        photo: the frame and its pose.
        services: of the run.
    """
    reason = f"{one.asset} was matched ({one.evidence}), but {why}"
    update = {"match": "no_asset", "asset": None, "runner_up": one.asset, "reason": reason}
    reply = (one.match or MatchEvidence(match="no_asset")).model_copy(update=update)
    words = Description(is_object=True, description=one.description, color=one.color,
                        shape=record.shape, category=one.category)  # fmt: skip
    found = Matched(record, words, reply)
    if reason := drop_reason(found, services.config.match.proxies):
        return DroppedCandidate(id=one.id, reason=reason)
    return object_of(found, services, taken, photo)
