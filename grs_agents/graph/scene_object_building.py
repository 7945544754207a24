"""From a candidate and what the agents said of it to an object of the scene.

An asset that cannot be what was measured, where it was measured, gives way to a proxy of that size.
"""

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from grs_agents.agents.types import Description
from grs_agents.base import Quat
from grs_agents.graph.services import Photo, Services
from grs_agents.perception.matching.confidence import confidence_of_fitting_asset
from grs_agents.perception.proxies.primitive_proxy import Proxy, primitive_proxy
from grs_agents.perception.proxies.proxy_writer import write_proxy
from grs_agents.perception.registration.size_check import (
    deviation_from_measured_box,
    is_match_certain,
    upright_box_from_aabb,
)
from grs_agents.perception.segmentation.candidates import fit_asset_to_box
from grs_agents.perception.shapes.mesh_file import MeshFile, fit_mesh_file
from grs_agents.perception.shapes.view import make_object_view
from grs_agents.perception.types import (
    CandidateRecord,
    DroppedCandidate,
    Mask,
    MatchEvidence,
    SceneObject,
    Solid,
    UprightBox,
    is_reachable_position,
)

QUIET = 0.0005  # no depth camera has less noise, m


@dataclass(frozen=True)
class MatchedCandidate:
    """A candidate, its description, and the answer of the match tool (``None``: not asked, it is no object)."""

    record: CandidateRecord
    description: Description
    reply: MatchEvidence | None


def explain_why_no_scene_object(candidate: MatchedCandidate, proxies: bool = True) -> str:
    """Why a candidate is no object of the scene; empty if it is one. Without proxies it needs an asset."""
    if candidate.record.given and proxies:
        return ""
    if candidate.reply is None:
        return f"described as no object: {candidate.description.description}"
    if candidate.reply.match == "no_object":
        return f"matched as no object: {candidate.reply.reason}"
    if candidate.reply.match == "no_asset" and not proxies:
        return f"no asset matches it, and match.proxies is off: {candidate.reply.reason}"
    return ""


def place_asset_or_proxy(
    candidate: MatchedCandidate, services: Services, taken: Sequence[str], photo: Photo
) -> SceneObject:
    """Place the matched asset, or a proxy, where the photo shows it.

    A proxy is a primitive of the measured size until its shape is reconstructed (`reconstruct_proxy`).
    """
    record, description, reply = candidate.record, candidate.description, candidate.reply
    if reply is not None and reply.match == "asset" and reply.asset is not None:
        asset = services.library.asset(reply.asset)
        position, orientation, size = fit_asset_to_box(record.upright, asset.size)
        name = _unique_object_name(asset.kind, taken)
    else:
        name = _unique_object_name(f"{description.color} {description.category}", taken)
        proxy = primitive_proxy(record.shape, record.upright.size, record.color, record.hollow)
        asset = write_proxy(services.folder / "assets", name, proxy, description.description)
        position, orientation, size = record.upright.center, yaw_quaternion(record.upright.yaw), asset.size
    return SceneObject(
        id=record.id,
        name=name,
        asset=asset.name,
        matched=asset.category != "proxy",
        description=description.description,
        category=description.category,
        color=description.color,
        box=record.box,
        upright=record.upright,
        position=position,
        orientation=orientation,
        size=size,
        reachable=is_reachable_position(position),
        evidence=reply.reason if reply else "",
        match=reply,
        mask=record.mask,
        crop=record.crop,
        method="box" if asset.category != "proxy" else "proxy",
    )


def reconstruct_proxy(
    record: CandidateRecord, box: UprightBox, solid: Solid, mask: Mask, photo: Photo, services: Services
) -> Proxy:
    """What stands for an object that no asset matches, with pixels ``mask`` (H, W), in the frame of its box.

    It is what the shape tool makes of the photo; where that has no shape, a primitive of the box's size.
    """
    view = make_object_view(*photo, mask, box, max(photo[1].residual, QUIET), record.hollow)
    config, folder = services.config, services.folder / "shapes"
    found = services.run_tool(config.tools.shape, view=view, folder=folder, model=config.shape.model).shape
    if isinstance(found, MeshFile):
        found = fit_mesh_file(found, view)
    if found is None:
        return primitive_proxy(solid, box.size, record.color, record.hollow, view)
    return Proxy.from_shape(found, record.color, solid, record.hollow)


def _unique_object_name(words: str, taken: Sequence[str]) -> str:
    """``words`` as a slug with a number that no other object of the scene has."""
    spaced = re.sub(r"(?<=[a-z])(?=[A-Z])", "_", words)
    slug = re.sub(r"[^a-z0-9]+", "_", spaced.lower()).strip("_")[:40] or "object"
    number = 1
    while f"{slug}_{number}" in taken:
        number += 1
    return f"{slug}_{number}"


def yaw_quaternion(yaw: float) -> Quat:
    """A rotation (xyzw) by a yaw, rad."""
    return (0.0, 0.0, math.sin(yaw / 2), math.cos(yaw / 2))


def replace_misfit_assets(
    objects: Sequence[SceneObject],
    records: Mapping[int, CandidateRecord],
    taken: Sequence[str],
    photo: Photo,
    services: Services,
) -> tuple[tuple[SceneObject, ...], list[DroppedCandidate]]:
    """The objects, each with an asset or a proxy of its size, and those that have neither."""
    kept: list[SceneObject] = []
    dropped: list[DroppedCandidate] = []
    for item in objects:
        why = describe_size_mismatch(item, services)
        names = [*taken, *(other.name for other in (*objects, *kept))]
        replaced = replace_by_proxy(item, why, records[item.id], names, photo, services) if why else item
        if isinstance(replaced, DroppedCandidate):
            dropped.append(replaced)
        else:
            kept.append(replaced)
    return tuple(kept), dropped


def raise_confidence_of_fit(item: SceneObject) -> SceneObject:
    """An object whose asset fits what was measured of it, with the confidence that this gives to the match."""
    match = item.match
    if not item.matched or match is None or match.confidence is None:
        return item
    sure = confidence_of_fitting_asset(match.confidence)
    return item.model_copy(update={"match": match.model_copy(update={"confidence": sure})})


def describe_size_mismatch(item: SceneObject, services: Services) -> str:
    """Why the asset of an object does not stand for what was measured of it; empty if it does, or is a proxy."""
    if not item.matched or is_match_certain(item):
        return ""
    deviation = deviation_from_measured_box(
        item.asset, (item.position, item.orientation), services.library, item.upright or upright_box_from_aabb(item.box)
    )
    return "" if deviation.is_within_tolerance else f"is not of the measured size there: {deviation}"


def replace_by_proxy(
    item: SceneObject, why: str, record: CandidateRecord, taken: Sequence[str], photo: Photo, services: Services
) -> SceneObject | DroppedCandidate:
    """An object with a proxy instead of its asset; or, without proxies, why it is none."""
    reason = f"{item.asset} was matched ({item.evidence}), but {why}"
    update = {"match": "no_asset", "asset": None, "runner_up": item.asset, "reason": reason}
    reply = (item.match or MatchEvidence(match="no_asset")).model_copy(update=update)
    words = Description(
        is_object=True, shape=record.shape, description=item.description, color=item.color, category=item.category
    )
    candidate = MatchedCandidate(record, words, reply)
    if reason := explain_why_no_scene_object(candidate, services.config.match.proxies):
        return DroppedCandidate(id=item.id, reason=reason)
    return place_asset_or_proxy(candidate, services, taken, photo)
