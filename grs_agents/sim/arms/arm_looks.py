"""Looks of the shipped arms: round solids on their links, by the makers' published dimensions, for rendering only.

A rendered model shows them in place of the collision capsules; a simulated model never has them.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final, Literal

from grs_agents.base import Vec3
from grs_agents.base.mujoco_import import mujoco

LINK_COLOR: Final = (0.84, 0.85, 0.86, 1.0)
JOINT_COLOR: Final = (0.34, 0.44, 0.55, 1.0)
_CAP: Final = 0.008
"""Protrusion of a joint's cap, metres."""
_GROUP: Final = 1
MOUNT: Final = "mount"
"""Frame of solids on the hand's body at the flange."""


@dataclass(frozen=True)
class Solid:
    """A round solid of a link: a cylinder, or a capsule with half balls around ``start`` and ``end``."""

    body: str  # frame of the solid; "world" for the fixed base, ``MOUNT``
    kind: Literal["cylinder", "capsule"]
    start: Vec3  # metres
    end: Vec3
    radius: float
    is_joint: bool = False  # in the colour of joints


def tube(body: str, start: Vec3, end: Vec3, radius: float) -> tuple[Solid, ...]:
    """A part of a link, m."""
    return (Solid(body, "capsule", start, end, radius),)


def housing(body: str, start: Vec3, end: Vec3, radius: float, caps: str) -> tuple[Solid, ...]:
    """A joint's housing from ``start`` to ``end``, m, with caps at the ends that ``caps`` names."""
    length = sum((b - a) ** 2 for a, b in zip(start, end, strict=True)) ** 0.5
    step = [_CAP * (b - a) / length for a, b in zip(start, end, strict=True)]
    solids = [Solid(body, "cylinder", start, end, radius)]
    for name, place, sign in (("start", start, -1), ("end", end, 1)):
        if name in caps:
            x, y, z = (a + sign * b for a, b in zip(place, step, strict=True))
            solids.append(Solid(body, "cylinder", place, (x, y, z), 0.93 * radius, True))
    return tuple(solids)


def ring(body: str, start: Vec3, end: Vec3, radius: float) -> tuple[Solid, ...]:
    """A band or a flange in the colour of joints, m."""
    return (Solid(body, "cylinder", start, end, radius, True),)


def set_arm_visuals(spec: Any, looks: Sequence[Solid], mount: str) -> None:
    """Replace the geoms of an arm's bodies in a rendered ``spec`` by ``looks``; other bodies and the hand stay.

    ``mount`` is the body of the hand at the flange.
    """
    bodies = {solid.body for solid in looks} - {"world", MOUNT}
    for name in bodies:
        for geom in list(spec.body(name).geoms):
            spec.delete(geom)
    kinds = {"cylinder": mujoco.mjtGeom.mjGEOM_CYLINDER, "capsule": mujoco.mjtGeom.mjGEOM_CAPSULE}
    for solid in looks:
        body = spec.worldbody if solid.body == "world" else spec.body(mount if solid.body == MOUNT else solid.body)
        body.add_geom(
            type=kinds[solid.kind],
            fromto=(*solid.start, *solid.end),
            size=(solid.radius, 0, 0),
            rgba=JOINT_COLOR if solid.is_joint else LINK_COLOR,
            mass=0.0,
            group=_GROUP,
            contype=0,
            conaffinity=0,
        )
