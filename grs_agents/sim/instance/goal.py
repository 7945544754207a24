"""Typed goals for new programs: how objects are to lie, said once for the scorer and for the oracle."""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any, Final, Literal, NamedTuple, cast

import numpy as np
import numpy.typing as npt

from grs_agents.base import Pose, Vec3
from grs_agents.sim.instance.episode import SimulationError

Kind = Literal["inside", "on", "stacked", "near", "aligned", "upright", "in_zone"]
KINDS: Final[tuple[Kind, ...]] = ("inside", "on", "stacked", "near", "aligned", "upright", "in_zone")
REFERENCED: Final = ("inside", "on", "near", "in_zone")
"""Relations to another object, which itself need not move."""


@dataclass(frozen=True)
class Relation:
    """How objects are to lie. Made by ``inside``, ``on``, ``stacked``, ``near``, ``aligned``, ``upright``, ``in_zone``.

    Attributes:
        kind: which relation.
        objects: ids of the objects it speaks of; for ``stacked`` from the bottom up.
        reference: id of the container, support, zone or neighbour.
        distance: ``near``: largest gap, metres; ``aligned``: from centre to centre, metres, None = any.

    Raises:
        SimulationError: an id or a number does not fit; the message says which, and what would.
    """

    kind: Kind
    objects: tuple[int, ...]
    reference: int | None = None
    distance: float | None = None

    def __post_init__(self) -> None:
        if self.kind not in KINDS:
            raise SimulationError(f"relation {self.kind!r} is unknown", f"use one of {', '.join(KINDS)}")
        if (self.reference is not None) != (self.kind in REFERENCED):
            raise SimulationError(
                f"relation {self.kind} with reference {self.reference}",
                f"{', '.join(REFERENCED)} have one, others none",
            )
        ids = (*self.objects, *(() if self.reference is None else (self.reference,)))
        if len(set(ids)) != len(ids):
            raise SimulationError(f"{self.kind} was given an object twice: {list(ids)}", "give different ids")
        least = 2 if self.kind == "stacked" or (self.kind == "aligned" and self.distance) else 1
        least = 3 if self.kind == "aligned" and not self.distance else least
        if len(self.objects) < least:
            remedy = f"give at least {least}" + (" or a spacing" if least == 3 else "")
            raise SimulationError(f"{self.kind} was given {len(self.objects)} objects", remedy)
        if self.distance is not None and not 0 < self.distance <= 1:
            raise SimulationError(f"{self.kind}: {self.distance} m is out of range", "give metres in 0..1")


def inside(objs: int | Iterable[int], container: int) -> Relation:
    """The objects lie in a container: below its rim, within its outline, held by it or by one another."""
    return Relation("inside", _ids(objs), _id(container))


def on(objs: int | Iterable[int], support: int) -> Relation:
    """The objects rest on a support, their centres over it."""
    return Relation("on", _ids(objs), _id(support))


def stacked(objs: Sequence[int]) -> Relation:
    """Each object rests on the one before it, its centre over it; the first is the bottom, which may be fixed."""
    return Relation("stacked", _ids(objs))


def near(objs: int | Iterable[int], other: int, distance: float = 0.05) -> Relation:
    """The objects lie beside another one, with a gap of at most ``distance`` metres."""
    return Relation("near", _ids(objs), _id(other), _metres("near", distance))


def aligned(objs: Sequence[int], spacing: float | None = None) -> Relation:
    """The objects' centres lie on one line, within 1 cm; ``spacing``: metres from each centre to the next, or any."""
    return Relation("aligned", _ids(objs), None, None if spacing is None else _metres("aligned", spacing))


def upright(objs: int | Iterable[int]) -> Relation:
    """The objects stand with their own z axis within 15 degrees of the vertical."""
    return Relation("upright", _ids(objs))


def in_zone(objs: int | Iterable[int], zone: int) -> Relation:
    """The objects lie wholly over a zone, on what it lies on or on one another."""
    return Relation("in_zone", _ids(objs), _id(zone))


UPRIGHT_WITHIN: Final = math.radians(15)


def _id(number: Any) -> int:
    if isinstance(number, int | np.integer) and not isinstance(number, bool):
        return int(cast(int, number))
    raise SimulationError(f"a relation was given {number!r} as an object", "give ids that env.add_object returned")


def _metres(kind: str, value: Any) -> float:
    try:
        return float(value)
    except (TypeError, ValueError) as error:
        raise SimulationError(f"{kind}: {value!r} is no distance"[:150], "give metres in 0..1") from error


def _ids(objs: Any) -> tuple[int, ...]:
    if isinstance(objs, Iterable):
        return tuple(_id(number) for number in cast(Iterable[Any], objs))
    return (_id(objs),)


Metric = Literal["pose", "zone", "relation"]

Zone = tuple[Pose, Vec3]
"""Pose of a zone's centre and its full extents, metres."""


class Goal(NamedTuple):
    """One goal; unpacks in CLIPort's order.

    Attributes:
        objs: object ids.
        matches: (objects, targets) zeros and ones.
        targ_poses: target poses.
        replace: objects may share a target.
        rotations: the target's yaw is asked for.
        metric: ``pose``, ``zone`` or ``relation``.
        params: the zones of a ``zone`` goal.
        step_max_reward: reward for the whole goal.
        symmetries: for each object, radians after which it looks the same; 0 = any yaw.
        relation: what a ``relation`` goal asks for; it has no targets.
    """

    objs: list[int]
    matches: npt.NDArray[np.int64]
    targ_poses: list[Pose]
    replace: bool
    rotations: bool
    metric: Metric
    params: list[Zone]
    step_max_reward: float
    symmetries: list[float]
    relation: Relation | None = None


def named(goal: Goal) -> list[int]:
    """Ids of all objects that a goal speaks of."""
    other = goal.relation.reference if goal.relation is not None else None
    return goal.objs if other is None else [*goal.objs, other]


def worth_one(goals: Sequence[Goal]) -> tuple[list[Goal], str]:
    """The goals with rewards that add up to 1, and a word on it if they had to be scaled."""
    total = sum(goal.step_max_reward for goal in goals)
    if not goals or abs(total - 1) <= 0.01:
        return list(goals), ""
    shares = [goal.step_max_reward / total if total > 0 else 1 / len(goals) for goal in goals]
    scaled = [goal._replace(step_max_reward=share) for goal, share in zip(goals, shares, strict=True)]
    return scaled, f"the goals' step_max_reward add up to {total:.2f}, scaled to 1"
