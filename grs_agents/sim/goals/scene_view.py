"""A snapshot of the scene for planning: outlines, names, what stands where, what rests on what.

The scores and the oracle share the rules of support and of lying still.
"""

import copy
import math
from collections.abc import Collection, Iterable, Mapping, Sequence
from typing import Any, Final

import numpy as np

from grs_agents.base import Pose, Vec3
from grs_agents.base.geometry import transforms
from grs_agents.base.geometry.transforms import FloatArray
from grs_agents.library.shapes import ObjectModel
from grs_agents.sim.instance.episode import Outcome, Stop
from grs_agents.sim.instance.goal import Goal
from grs_agents.sim.instance.task_instance import ROTATION_TOLERANCE
from grs_agents.sim.world.collision_volumes import Volume
from grs_agents.sim.world.footprints import (
    Prism,
    collider_prisms_at_pose,
    convex_hull,
    find_nearby_prisms,
    intersect_outlines,
    margins_inside_outline,
    object_prism_at_pose,
    rotation_matrix_2d,
    signed_outline_gaps,
)
from grs_agents.sim.world.tabletop import Tabletop

_POINT = np.zeros((1, 2))


def tilt_of_pose(pose: Pose) -> float:
    """The angle between an object's own z axis and the vertical, radians."""
    x, y, _, _ = pose[1]
    return math.acos(min(1.0, max(-1.0, 1 - 2 * (x * x + y * y))))


class SceneView:
    """What the oracle looks at when it plans one action; ``stated`` are all goals, ``open_goals`` those not met yet.
    ``packings`` is what was planned for scenes on this table before, by all that such a plan depends on."""

    def __init__(
        self,
        table: Tabletop,
        stated: Sequence[Goal],
        open_goals: Sequence[Goal],
        packings: dict[Any, Any] | None = None,
    ) -> None:
        self._table, self.physics = table, table.physics
        self.arm, self.bounds, self.places, self.ties = table.arm, table.bounds, table.places, table.object_ties
        self.stated_goals, self.open_goals = stated, open_goals
        self._items = {item.id: item for item in table.objects}
        self._models = {number: table.object_model(number) for number in self._items}
        self.prisms: list[Prism] = table.collider_prisms()
        self._supposed: dict[int, Prism] = {}
        self.packings: dict[Any, Any] = {} if packings is None else packings

    @property
    def arrangement(self) -> tuple[Any, ...]:
        """What stands where, to compare scenes by."""
        return tuple(
            (item.id, item.asset, repr(item.fill), item.category, item.role, item.pose) for item in self._items.values()
        )

    def copy_with_object_poses(self, poses: Mapping[int, Pose]) -> "SceneView":
        """The same scene with some objects elsewhere: what a plan would bring about."""
        other = copy.copy(self)
        other._items = self._items | {
            number: self._items[number].model_copy(update={"pose": pose}) for number, pose in poses.items()
        }
        other._supposed = self._supposed | {
            number: object_prism_at_pose(self._models[number], pose, number) for number, pose in poses.items()
        }
        moved = [
            prism
            for number, pose in poses.items()
            for prism in collider_prisms_at_pose(self._models[number], pose, number)
        ]
        other.prisms = [*self.prisms_of_other_objects(*poses), *moved]
        return other

    @property
    def object_ids(self) -> tuple[int, ...]:
        """Every object."""
        return tuple(self._items)

    def object_name(self, number: int) -> str:
        """The asset name of an object."""
        return self._items[number].asset

    def object_label(self, number: int) -> str:
        """Its asset name and its id, which tells it from others of that asset."""
        return f"{self.object_name(number)} #{number}"

    def object_pose(self, number: int) -> Pose:
        """Where it is."""
        return self._items[number].pose

    def object_yaw(self, number: int) -> float:
        """How it is turned about the vertical, radians."""
        return transforms.yaw_of_quaternion(self.object_pose(number)[1])

    def object_tilt(self, number: int) -> float:
        """The angle between its own z axis and the vertical, radians."""
        return tilt_of_pose(self.object_pose(number))

    def object_tilt_at_start(self, number: int) -> float:
        """That angle when the scene had settled, before anything acted."""
        start = self.places.get(number)
        return 0.0 if start is None else tilt_of_pose(start)

    def object_model(self, number: int) -> ObjectModel:
        """What it is made of."""
        return self._models[number]

    def object_volume(self, number: int) -> Volume:
        """Its collision volume."""
        return self._table.object_collision_points(number)

    def is_object_movable(self, number: int) -> bool:
        """Whether it can be moved."""
        return self._table.is_object_movable(number)

    def is_bystander(self, number: int) -> bool:
        """Whether it stands there because the photo shows it, and must stay as it is."""
        return self._items[number].role == "bystander"

    def may_robot_move(self, number: int) -> bool:
        """Whether the robot may move it: it is loose and belongs to the task."""
        return self.is_object_movable(number) and not self.is_bystander(number)

    def is_object_hollow(self, number: int) -> bool:
        """Whether things can be put into it."""
        return self._table.library.asset(self.object_name(number)).hollow

    def object_prism(self, number: int) -> Prism:
        """One prism around the whole object."""
        return self._supposed[number] if number in self._supposed else self._table.object_prism(number)

    def collider_prisms(self, number: int) -> list[Prism]:
        """The prisms of one object's colliders."""
        return [prism for prism in self.prisms if prism.owner == number]

    def object_extent_xy(self, number: int) -> tuple[float, float]:
        """Horizontal extents along its own axes as it stands, metres."""
        outline = self.object_prism(number).outline @ rotation_matrix_2d(self.object_yaw(number))
        size = outline.max(axis=0) - outline.min(axis=0)
        return (float(size[0]), float(size[1]))

    def prisms_of_other_objects(self, *numbers: int) -> list[Prism]:
        """The prisms of every object but these."""
        return [prism for prism in self.prisms if prism.owner not in numbers]

    def obstacles_to_plan_around(self, numbers: Collection[int], footing: Collection[int] = ()) -> list[Prism]:
        """The prisms of every object but ``numbers``; only what is fixed, and ``footing``, has a top to stand on."""

        def carries(owner: int) -> bool:
            return not self.is_bystander(owner) and (owner in footing or not self.is_object_movable(owner))

        tops = {number for number in self.object_ids if carries(number)}
        return [
            prism if prism.owner in tops else prism.without_top for prism in self.prisms if prism.owner not in numbers
        ]

    def is_point_over_object(self, number: int, point: Vec3) -> bool:
        """Whether a point lies above an object's outline, seen from above."""
        offset = np.array([[point[0], point[1]]])
        return bool(margins_inside_outline(_POINT, self.object_prism(number).outline, offset)[0] >= 0)


_TOUCHING: Final = 0.006
_FOOTING: Final = 0.002
"""How far within what carries it a centre of mass must lie, metres."""
_OVERLAP: Final = -0.0005
_STILL: Final = 0.05
_TILTED: Final = math.radians(5)
"""Targets that lean by less are meant upright: programs compute them from poses that settled."""
_GRAIN: Final = 0.02
"""What is no larger than this lies as it falls: any of its sides will do, metres."""


def supporting_object_ids(number: int, view: SceneView) -> set[int]:
    """Ids of the objects whose top an object's underside rests on; empty on the bare table."""
    own = [prism for prism in view.prisms if prism.owner == number]
    low = min((prism.low for prism in own), default=0.0)
    feet = [prism for prism in own if prism.low < low + _TOUCHING]
    return {prism.owner for prism in view.prisms_of_other_objects(number) if _is_prism_supporting_any(prism, feet)}


def carried_object_ids(number: int, view: SceneView) -> list[int]:
    """Ids of the objects that rest on an object, or in it, with a foot at least."""
    own = view.object_prism(number)
    above = [prism for prism in map(view.object_prism, view.object_ids) if prism.low > own.low + _TOUCHING]
    near = find_nearby_prisms(own, above, (0.0, 0.0), 0.0)
    return [prism.owner for prism in near if number in supporting_object_ids(prism.owner, view)]


def enclosing_object_ids(number: int, view: SceneView) -> set[int]:
    """Ids of what an object on the table stands in, without a top of theirs under it: fixtures, rings."""
    own = view.object_prism(number)
    return {
        other
        for other in view.object_ids
        if own.low < _TOUCHING
        and other != number
        and view.object_model(other).colliders
        and view.object_prism(other).low < own.high
        and view.object_prism(other).high > own.low
        and view.is_point_over_object(other, view.object_pose(number)[0])
    }


def mark_ids_under_object(number: int, view: SceneView) -> set[int]:
    """Ids of the marks on the table on which an object stands; empty if it is not on the table."""
    if view.object_prism(number).low > _TOUCHING:
        return set()
    return {
        other
        for other in view.object_ids
        if not view.object_model(other).colliders
        and abs(view.object_prism(other).high) < _TOUCHING
        and view.is_point_over_object(other, view.object_pose(number)[0])
    }


def _is_prism_supporting_any(prism: Prism, feet: Iterable[Prism]) -> bool:
    return any(
        abs(foot.low - prism.high) < _TOUCHING
        and signed_outline_gaps(foot.outline, prism.outline, _POINT)[0] < _OVERLAP
        for foot in feet
    )


def is_placement_stable(parts: Sequence[Prism], height: float, center: FloatArray, others: Iterable[Prism]) -> bool:
    """Whether a body with its underside at a height (m) has its centre of mass (2,) over what would carry it."""
    if height < _TOUCHING:
        return True
    low = min(part.low for part in parts)
    feet = [part for part in parts if part.low < low + _TOUCHING]
    carriers = [prism for prism in others if abs(prism.high - height) < _TOUCHING]
    touching = [
        intersect_outlines(foot.outline, top.outline)
        for foot in feet
        for top in find_nearby_prisms(foot, carriers, (0.0, 0.0), 0.0)
    ]
    base = convex_hull(np.vstack([np.zeros((0, 2)), *touching]))
    return len(base) > 2 and bool(margins_inside_outline(_POINT, base, center[None])[0] > _FOOTING)


def has_toppled(number: int, view: SceneView, tolerance: float) -> bool:
    """Whether an object is more tilted than at the start, by more than ``tolerance`` radians; no ball or grain is."""
    return not cannot_topple(number, view) and view.object_tilt(number) > view.object_tilt_at_start(number) + tolerance


def is_target_tilted(target: Pose) -> bool:
    """Whether a target pose says of an object that it is not to stand upright."""
    return tilt_of_pose(target) > _TILTED


def cannot_topple(number: int, view: SceneView) -> bool:
    """Whether any side of an object will do: it is a ball, or a grain."""
    model = view.object_model(number)
    return all(shape.kind == "sphere" for shape in model.colliders) or max(model.size) <= _GRAIN


def describe_tilt(number: int, view: SceneView) -> str:
    """How an object is tilted, in words."""
    now, start = math.degrees(view.object_tilt(number)), math.degrees(view.object_tilt_at_start(number))
    return f"it is tilted by {now:.0f} degrees, at the start by {start:.0f}"


def make_oracle_stop(outcome: Outcome, detail: str, view: SceneView, *numbers: int) -> Stop:
    """Why the oracle stops, about objects; the detail says which of them have tipped over, as it may be the cause."""
    tipped = [
        f"; {view.object_label(number)} has tipped over: {describe_tilt(number, view)}"
        for number in numbers
        if has_toppled(number, view, ROTATION_TOLERANCE)
    ]
    return Stop(outcome, detail + "".join(tipped), tuple(dict.fromkeys(map(view.object_name, numbers))))


def describe_unmovables(numbers: Iterable[int], view: SceneView) -> str:
    """Objects that the robot may not move in words, with the reasons."""
    owners = list(dict.fromkeys(numbers))
    staying = [view.object_label(number) for number in owners if view.is_bystander(number)]
    fixed = [view.object_label(number) for number in owners if not view.is_bystander(number)]
    reasons = ((staying, "must stay where the photo shows it"), (fixed, "is fixed"))
    return "; ".join(f"{' and '.join(labels)}, which {reason}" for labels, reason in reasons if labels)


def is_at_rest(number: int, view: SceneView) -> bool:
    """Whether an object lies still, let go by the robot."""
    return view.physics.held_object_id != number and view.physics.object_speed(number) < _STILL
