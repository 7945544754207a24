"""An asset that is not of the size that was measured, where it was measured, gives way to a proxy that is."""

from collections.abc import Mapping, Sequence

from grs_agents.agents import Description
from grs_agents.nodes.matching import Matched, dropped, object_of
from grs_agents.nodes.services import Services
from grs_agents.scene import (
    CandidateRecord,
    DroppedCandidate,
    MatchEvidence,
    RGBDFrame,
    SceneObject,
    TableFrame,
    deviation,
    upright_of,
)


def fitting(
    objects: Sequence[SceneObject],
    records: Mapping[int, CandidateRecord],
    taken: Sequence[str],
    photo: tuple[RGBDFrame, TableFrame],
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
        reply = _refused(one, services)
        if reply is None:
            kept.append(one)
            continue
        words = Description(is_object=True, description=one.description, color=one.color,
                            shape=records[one.id].shape, category=one.category)  # fmt: skip
        found = Matched(records[one.id], words, reply)
        if reason := dropped(found, services.config.match.proxies):
            lost.append(DroppedCandidate(id=one.id, reason=reason))
        else:
            names = [*taken, *(other.name for other in (*objects, *kept))]
            kept.append(object_of(found, services, names, photo))
    return tuple(kept), lost


def _refused(one: SceneObject, services: Services) -> MatchEvidence | None:
    """What to say of the match of an object instead, if its asset is not of its size; ``None`` if it is."""
    if not one.matched:
        return None
    measured = one.upright or upright_of(one.box)
    off = deviation(one.asset, (one.position, one.orientation), services.library, measured)
    if off.agrees:
        return None
    reason = f"{one.asset} was matched ({one.evidence}), but is not of the measured size there: {off}"
    update = {"match": "no_asset", "asset": None, "runner_up": one.asset, "reason": reason}
    return (one.match or MatchEvidence(match="no_asset")).model_copy(update=update)
