"""Goals of a task, defined once for the scorer, for the oracle and for task instances on disk."""

import math
from collections.abc import Iterable, Sequence
from typing import Annotated, Any, Final, Literal, Self, cast

import numpy as np
from pydantic import Field, model_validator

from grs_agents.base import Frozen, Pose
from grs_agents.sim.instance.episode import SimulationError

LARGEST_POSITION = 2.0
"""Metres from the robot base, along any axis."""

Coordinate = Annotated[float, Field(allow_inf_nan=False, ge=-LARGEST_POSITION, le=LARGEST_POSITION)]
Unit = Annotated[float, Field(allow_inf_nan=False, ge=-1.001, le=1.001)]
Extent = Annotated[float, Field(allow_inf_nan=False, gt=0, le=2)]
Placed = tuple[tuple[Coordinate, Coordinate, Coordinate], tuple[Unit, Unit, Unit, Unit]]

Kind = Literal["inside", "on", "stacked", "near", "aligned", "upright", "in_zone"]
REFERENCED: Final = ("inside", "on", "near", "in_zone")
"""Relations to a reference object, which itself need not move."""
LONGEST_SENTENCE: Final = 2000
"""Characters of a goal's sentence."""
UPRIGHT_WITHIN: Final = math.radians(15)


def check_unit_quaternion(pose: Pose, owner: str) -> None:
    """Refuse a pose whose rotation is no unit quaternion, with a ``ValueError``."""
    norm = math.hypot(*pose[1])
    if not 0.99 < norm < 1.01:
        raise ValueError(f"{owner}: quaternion {pose[1]} has length {norm:.3f}, must be 1")


class Zone(Frozen):
    """A region: its pose and full extents (x, y, z) in metres; z is not scored."""

    pose: Placed
    size: tuple[Extent, Extent, Annotated[float, Field(allow_inf_nan=False, ge=0, le=2)]]


class Relation(Frozen):
    """Relation that a typed goal asks for; ``sim.goals.relation_rules`` defines each kind strictly."""

    kind: Kind
    # id of the container, support, zone or neighbour, for the kinds of ``REFERENCED``
    reference: Annotated[int, Field(ge=0, le=100_000)] | None = None
    # ``near``: largest gap; ``aligned``: spacing of centres, None = any; metres
    distance: Annotated[float, Field(allow_inf_nan=False, gt=0, le=1)] | None = None

    @model_validator(mode="after")
    def _check_reference_matches_kind(self) -> Self:
        if (self.reference is not None) != (self.kind in REFERENCED):
            raise ValueError(f"relation {self.kind} with reference {self.reference}: {REFERENCED} have one")
        return self


class Goal(Frozen):
    """A goal; goals are met in their order.

    While a program runs, goals are built without the checks of this model (``model_construct``): their rewards are not
    scaled yet, and values out of range are refused when the task becomes an instance.
    """

    objects: Annotated[tuple[int, ...], Field(min_length=1, max_length=200)]  # for ``stacked`` from the bottom up
    # for each object, for each target, 1 if the target is allowed
    matches: tuple[tuple[Annotated[int, Field(ge=0, le=1)], ...], ...]
    targets: Annotated[tuple[Placed, ...], Field(max_length=200)]
    replace: bool  # several objects may share a target
    rotations: bool  # the yaw of the target matters
    # ``pose``: xy within ``pos_eps``, yaw within ``rot_eps``; ``zone``: share of volume inside
    metric: Literal["pose", "zone", "relation"]
    zones: Annotated[tuple[Zone, ...], Field(max_length=50)] = ()
    max_reward: Annotated[float, Field(allow_inf_nan=False, ge=0, le=1.0001)]
    # for each object, the angle (rad) after which it looks the same; 0 = any yaw
    symmetries: tuple[Annotated[float, Field(allow_inf_nan=False, ge=0, le=6.3)], ...]
    language: Annotated[str, Field(max_length=LONGEST_SENTENCE)] = ""
    relation: Relation | None = None  # for the metric ``relation``; such a goal has no targets

    @model_validator(mode="after")
    def _check_goal_fields_agree(self) -> Self:
        if self.metric == "pose" and not self.targets:
            raise ValueError("a pose goal needs at least one target pose")
        if self.metric == "zone" and not self.zones:
            raise ValueError("a zone goal needs at least one zone")
        if (self.metric == "relation") != (self.relation is not None):
            raise ValueError(f"metric {self.metric} with relation {self.relation}: 'relation' goals alone have one")
        if len(self.matches) != len(self.objects) or len(self.symmetries) != len(self.objects):
            raise ValueError(f"{len(self.objects)} objects need as many rows of matches and symmetries")
        if any(len(row) != len(self.targets) for row in self.matches):
            raise ValueError(f"each row of matches needs {len(self.targets)} entries, one for each target")
        for pose in self.targets:
            check_unit_quaternion(pose, "target")
        return self

    @property
    def relation_kind(self) -> Kind | None:
        """Kind of relation of a typed goal, None for other goals."""
        return self.relation.kind if self.relation is not None else None

    @property
    def required_distance(self) -> float | None:
        """Distance of a typed goal that has any, metres."""
        return self.relation.distance if self.relation is not None else None

    @property
    def reference_id(self) -> int:
        """Id of the container, support, zone or neighbour of a typed goal of the kinds of ``REFERENCED``."""
        assert self.relation is not None and self.relation.reference is not None, (
            f"{self.relation_kind} without a reference"
        )
        return self.relation.reference

    @property
    def mentioned_object_ids(self) -> tuple[int, ...]:
        """Ids of all objects of the goal, the reference included."""
        return (*self.objects, self.reference_id) if self.relation_kind in REFERENCED else self.objects

    def allowed_target_indices(self, row: int) -> list[int]:
        """Indices of the targets allowed for the object of a row."""
        return [index for index, match in enumerate(self.matches[row]) if match]

    def has_same_relation(self, other: "Goal") -> bool:
        """Whether two typed goals ask for the same relation to the same object."""
        return (
            self.relation is not None
            and other.relation is not None
            and (self.relation.kind, self.relation.reference) == (other.relation.kind, other.relation.reference)
        )

    def check_relation(self) -> None:
        """Refuse an inconsistent typed goal with a ``SimulationError``."""
        relation, count = self.relation, len(self.objects)
        if relation is None:
            return
        ids, distance = self.mentioned_object_ids, relation.distance
        if len(set(ids)) != len(ids):
            raise SimulationError(f"{relation.kind} was given an object twice: {list(ids)}", "give different ids")
        least = {"stacked": 2, "aligned": 2 if distance else 3}.get(relation.kind, 1)
        if count < least:
            remedy = f"give at least {least}" + (" or a spacing" if least == 3 else "")
            raise SimulationError(f"{relation.kind} was given {count} objects", remedy)
        if distance is not None and not 0 < distance <= 1:
            raise SimulationError(f"{relation.kind}: {distance} m is out of range", "give metres in 0..1")


def _make_relation_goal(
    kind: Kind, objects: tuple[int, ...], reference: int | None = None, distance: float | None = None
) -> Goal:
    goal = Goal.model_construct(
        objects=objects,
        matches=((),) * len(objects),
        targets=(),
        replace=False,
        rotations=False,
        metric="relation",
        max_reward=1.0,
        symmetries=(0.0,) * len(objects),
        relation=Relation.model_construct(kind=kind, reference=reference, distance=distance),
    )
    goal.check_relation()
    return goal


def inside(objs: int | Iterable[int], container: int) -> Goal:
    """The objects lie in a container: their undersides below its rim, within its outline, held by it or by one another;
    they may rise above the rim.
    """
    return _make_relation_goal("inside", _parse_object_ids(objs), _parse_object_id(container))


def on(objs: int | Iterable[int], support: int) -> Goal:
    """The objects rest on a support, their centres over it."""
    return _make_relation_goal("on", _parse_object_ids(objs), _parse_object_id(support))


def stacked(objs: Sequence[int]) -> Goal:
    """Each object rests on the one before it, its centre over it; the first is the bottom, which may be fixed."""
    return _make_relation_goal("stacked", _parse_object_ids(objs))


def near(objs: int | Iterable[int], other: int, distance: float = 0.05) -> Goal:
    """The objects lie beside another one, with a gap of at most ``distance`` metres."""
    return _make_relation_goal(
        "near", _parse_object_ids(objs), _parse_object_id(other), _parse_distance("near", distance)
    )


def aligned(objs: Sequence[int], spacing: float | None = None) -> Goal:
    """The objects' centres lie on one line, within 1 cm; ``spacing``: metres from each centre to the next, or any."""
    return _make_relation_goal(
        "aligned", _parse_object_ids(objs), None, None if spacing is None else _parse_distance("aligned", spacing)
    )


def upright(objs: int | Iterable[int]) -> Goal:
    """The objects stand with their own z axis within 15 degrees of the vertical."""
    return _make_relation_goal("upright", _parse_object_ids(objs))


def in_zone(objs: int | Iterable[int], zone: int) -> Goal:
    """The objects lie wholly over a zone, on what it lies on or on one another."""
    return _make_relation_goal("in_zone", _parse_object_ids(objs), _parse_object_id(zone))


def _parse_object_id(number: Any) -> int:
    if isinstance(number, int | np.integer) and not isinstance(number, bool):
        return int(cast(int, number))
    raise SimulationError(f"a relation was given {number!r} as an object", "give ids that env.add_object returned")


def _parse_distance(kind: str, value: Any) -> float:
    try:
        return float(value)
    except (TypeError, ValueError) as error:
        raise SimulationError(f"{kind}: {value!r} is no distance"[:150], "give metres in 0..1") from error


def _parse_object_ids(objs: Any) -> tuple[int, ...]:
    if isinstance(objs, Iterable):
        return tuple(_parse_object_id(number) for number in cast(Iterable[Any], objs))
    return (_parse_object_id(objs),)


def normalise_goal_rewards(goals: Sequence[Goal]) -> tuple[list[Goal], str]:
    """The goals with rewards that add up to 1, and a note if they had to be scaled."""
    total = sum(goal.max_reward for goal in goals)
    if not goals or abs(total - 1) <= 0.01:
        return list(goals), ""
    shares = [goal.max_reward / total if total > 0 else 1 / len(goals) for goal in goals]
    scaled = [goal.model_copy(update={"max_reward": share}) for goal, share in zip(goals, shares, strict=True)]
    return scaled, f"the goals' step_max_reward add up to {total:.2f}, scaled to 1"
