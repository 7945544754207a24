"""From a candidate and what the agents said of it to an object of the scene."""

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass

from grs_agents.agents import Description, Match, NoReply
from grs_agents.base import Quat
from grs_agents.library import Asset, write_proxy
from grs_agents.nodes.services import Services
from grs_agents.scene import CandidateRecord, SceneObject, UprightBox, place_asset
from grs_agents.scene.types import Solid
from grs_agents.workspace import reachable


@dataclass(frozen=True)
class Matched:
    """A candidate, its description, and the matcher's reply (``None``: not asked, it is no object)."""

    record: CandidateRecord
    description: Description
    reply: Match | NoReply | None


def dropped(found: Matched) -> str:
    """Why a candidate is no object; empty if it is one."""
    if found.reply is None:
        return f"described as no object: {found.description.description}"
    if isinstance(found.reply, Match) and found.reply.match == "no_object":
        return f"matched as no object: {found.reply.reason}"
    return ""


def object_of(found: Matched, services: Services, taken: Sequence[str]) -> SceneObject:
    """Place the matched asset, or a primitive proxy of the measured size and colour, where the photo shows it."""
    record, description, reply = found.record, found.description, found.reply
    if isinstance(reply, Match) and reply.match == "asset" and reply.asset is not None:
        asset = services.library.asset(reply.asset)
        position, orientation, size = place_asset(record.upright, asset.size)
        name, evidence = _unique(asset.kind, taken), reply.reason
    else:
        name = _unique(f"{description.color} {description.category}", taken)
        asset = write_stand_in(name, record, record.upright, record.shape, description.description, services)
        position, orientation, size = record.upright.center, about_z(record.upright.yaw), asset.size
        evidence = str(reply) if isinstance(reply, NoReply) else (reply.reason if reply else "")
    return SceneObject(
        id=record.id,
        name=name,
        asset=asset.name,
        matched=asset.category != "proxy",
        description=description.description,
        category=description.category,
        color=description.color,
        box=record.box,
        position=position,
        orientation=orientation,
        size=size,
        reachable=reachable(position),
        evidence=evidence,
        mask=record.mask,
        crop=record.crop,
        method="box" if asset.category != "proxy" else "proxy",
    )


def write_stand_in(
    name: str, record: CandidateRecord, box: UprightBox, shape: Solid, description: str, services: Services
) -> Asset:
    """Write the proxy of an object into the library of the run; one of that name is replaced."""
    folder = services.folder / "assets"
    folder.mkdir(exist_ok=True)
    return write_proxy(folder, name, shape, box.size, record.color, description)


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
