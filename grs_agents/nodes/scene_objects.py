"""From a candidate and what the agents said of it to an object of the scene."""

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass

from grs_agents.agents import Description
from grs_agents.base import Quat
from grs_agents.library import Asset
from grs_agents.nodes.services import Photo, Services
from grs_agents.perception import (
    CandidateRecord,
    Mask,
    MatchEvidence,
    SceneObject,
    Surroundings,
    UprightBox,
    load_mask,
    place_asset,
)
from grs_agents.perception.proxies.fitted import write_fitted_proxy, write_proxy
from grs_agents.perception.proxies.kind import fitted_kind
from grs_agents.perception.proxies.measurement import measured_shape, proxy_look
from grs_agents.perception.types import Solid, reachable


@dataclass(frozen=True)
class Matched:
    """A candidate, its description, and the answer of the match tool (``None``: not asked, it is no object)."""

    record: CandidateRecord
    description: Description
    reply: MatchEvidence | None


def drop_reason(found: Matched, proxies: bool = True) -> str:
    """Why a candidate is no object of the scene; empty if it is one. Without proxies it needs an asset."""
    if found.reply is None:
        return f"described as no object: {found.description.description}"
    if found.reply.match == "no_object":
        return f"matched as no object: {found.reply.reason}"
    if found.reply.match == "no_asset" and not proxies:
        return f"no asset matches it, and match.proxies is off: {found.reply.reason}"
    return ""


def object_of(found: Matched, services: Services, taken: Sequence[str], photo: Photo | None = None) -> SceneObject:
    """Place the matched asset, or a proxy, where the photo shows it.

    A proxy has the measured size; with the photo it is the solid that fits the points best and looks as they do.
    """
    record, description, reply = found.record, found.description, found.reply
    if reply is not None and reply.match == "asset" and reply.asset is not None:
        asset = services.library.asset(reply.asset)
        position, orientation, size = place_asset(record.upright, asset.size)
        name = _unique(asset.kind, taken)
    else:
        name = _unique(f"{description.color} {description.category}", taken)
        asset = write_stand_in(name, record, record.upright, record.shape, description.description, services, photo)
        position, orientation, size = record.upright.center, about_z(record.upright.yaw), asset.size
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
        reachable=reachable(position),
        evidence=reply.reason if reply else "",
        match=reply,
        mask=record.mask,
        crop=record.crop,
        method="box" if asset.category != "proxy" else "proxy",
    )


def write_stand_in(
    name: str,
    record: CandidateRecord,
    box: UprightBox,
    shape: Solid,
    description: str,
    services: Services,
    photo: Photo | None = None,
    around: Surroundings | None = None,
    mask: Mask | None = None,
) -> Asset:
    """Write the proxy of an object into the library of the run; one of that name is replaced.

    ``mask`` are its pixels (H, W), where those are not the candidate's alone.
    """
    folder = services.folder / "assets"
    folder.mkdir(exist_ok=True)
    if photo is None:
        return write_proxy(folder, name, shape, box.size, record.color, description)
    mask = load_mask(services.folder / record.mask) if mask is None else mask
    measured = measured_shape(*photo, mask, box, around)
    kind = fitted_kind(measured, box.size, shape == "cylinder", record.hollow)
    look = proxy_look(*photo, mask, box)
    return write_fitted_proxy(folder, name, kind, measured, box.size, record.color, description, look)


def _unique(words: str, taken: Sequence[str]) -> str:
    """``words`` as a slug with a number that no other object of the scene has."""
    spaced = re.sub(r"(?<=[a-z])(?=[A-Z])", "_", words)
    slug = re.sub(r"[^a-z0-9]+", "_", spaced.lower()).strip("_")[:40] or "object"
    number = 1
    while f"{slug}_{number}" in taken:
        number += 1
    return f"{slug}_{number}"


def about_z(yaw: float) -> Quat:
    """A rotation (xyzw) by a yaw, rad."""
    return (0.0, 0.0, math.sin(yaw / 2), math.cos(yaw / 2))
