"""Snapshot of the scene for planning and scoring: poses, outlines, names, support relations.

Scores and oracle share its rules of support and rest.
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
from grs_agents.sim.tabletop import TabletopSim
from grs_agents.sim.world.collision_volumes import Volume
from grs_agents.sim.world.colors import painted_color
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

_POINT = np.zeros((1, 2))


def tilt_of_pose(pose: Pose) -> float:
    """Angle between an object's z axis and the vertical, radians."""
    x, y, _, _ = pose[1]
    return math.acos(min(1.0, max(-1.0, 1 - 2 * (x * x + y * y))))


class PlanningScene:
    """The scene at a moment in time, with the goals: ``stated`` are all of them, ``open_goals`` those not yet met.
    ``packings`` caches zone packings, by everything they depend on, across scenes of a table."""

    def __init__(
        self,
        table: TabletopSim,
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
        """Hashable key of all objects and poses, to compare scenes by."""
        return tuple(
            (item.id, item.asset, repr(item.fill), item.category, item.role, item.pose) for item in self._items.values()
        )

    def copy_with_object_poses(self, poses: Mapping[int, Pose]) -> "PlanningScene":
        """The same scene with some objects moved: the predicted result of a plan."""
        moved_scene = copy.copy(self)
        moved_scene._items = self._items | {
            number: self._items[number].model_copy(update={"pose": pose}) for number, pose in poses.items()
        }
        moved_scene._supposed = self._supposed | {
            number: object_prism_at_pose(self._models[number], pose, number) for number, pose in poses.items()
        }
        moved = [
            prism
            for number, pose in poses.items()
            for prism in collider_prisms_at_pose(self._models[number], pose, number)
        ]
        moved_scene.prisms = [*self.prisms_of_other_objects(*poses), *moved]
        return moved_scene

    @property
    def object_ids(self) -> tuple[int, ...]:
        """Ids of all objects."""
        return tuple(self._items)

    def object_name(self, number: int) -> str:
        """Asset name of an object."""
        return self._items[number].asset

    def object_color(self, number: int) -> str:
        """Colour name of an object that the program painted, else empty."""
        return painted_color(self._items[number])

    def object_label(self, number: int) -> str:
        """Asset name and id, unique among objects of the same asset."""
        return f"{self.object_name(number)} #{number}"

    def object_pose(self, number: int) -> Pose:
        """Pose in the robot frame, m."""
        return self._items[number].pose

    def object_yaw(self, number: int) -> float:
        """Yaw about the vertical, radians."""
        return transforms.yaw_of_quaternion(self.object_pose(number)[1])

    def object_tilt(self, number: int) -> float:
        """Angle between the object's z axis and the vertical, radians."""
        return tilt_of_pose(self.object_pose(number))

    def object_tilt_at_start(self, number: int) -> float:
        """That angle once the scene had settled, before any action."""
        start = self.places.get(number)
        return 0.0 if start is None else tilt_of_pose(start)

    def object_model(self, number: int) -> ObjectModel:
        """Colliders and visuals."""
        return self._models[number]

    def object_volume(self, number: int) -> Volume:
        """Sampled collision volume."""
        return self._table.object_collision_points(number)

    def is_object_movable(self, number: int) -> bool:
        """Whether the object is free to move."""
        return self._table.is_object_movable(number)

    def is_bystander(self, number: int) -> bool:
        """Whether the object stands there because the photo shows it, and must stay."""
        return self._items[number].role == "bystander"

    def may_robot_move(self, number: int) -> bool:
        """Whether the robot may move the object: it is loose and belongs to the task."""
        return self.is_object_movable(number) and not self.is_bystander(number)

    def is_object_hollow(self, number: int) -> bool:
        """Whether objects fit into it, as into a container."""
        return self._table.library.asset(self.object_name(number)).hollow

    def object_prism(self, number: int) -> Prism:
        """Upright prism around the whole object."""
        return self._supposed[number] if number in self._supposed else self._table.object_prism(number)

    def collider_prisms(self, number: int) -> list[Prism]:
        """Prisms of the object's colliders."""
        return [prism for prism in self.prisms if prism.owner == number]

    def object_extent_xy(self, number: int) -> tuple[float, float]:
        """Horizontal extents along the object's own axes at its current pose, metres."""
        outline = self.object_prism(number).outline @ rotation_matrix_2d(self.object_yaw(number))
        size = outline.max(axis=0) - outline.min(axis=0)
        return (float(size[0]), float(size[1]))

    def prisms_of_other_objects(self, *numbers: int) -> list[Prism]:
        """Prisms of every object but these."""
        return [prism for prism in self.prisms if prism.owner not in numbers]

    def obstacles_to_plan_around(self, numbers: Collection[int], footing: Collection[int] = ()) -> list[Prism]:
        """Prisms of every object but ``numbers``; only fixed objects and ``footing`` have a top to stand on."""

        def carries(owner: int) -> bool:
            return not self.is_bystander(owner) and (owner in footing or not self.is_object_movable(owner))

        tops = {number for number in self.object_ids if carries(number)}
        return [
            prism if prism.owner in tops else prism.without_top for prism in self.prisms if prism.owner not in numbers
        ]

    def is_point_over_object(self, number: int, point: Vec3) -> bool:
        """Whether a point lies within an object's outline, seen from above."""
        offset = np.array([[point[0], point[1]]])
        return bool(margins_inside_outline(_POINT, self.object_prism(number).outline, offset)[0] >= 0)


_TOUCHING: Final = 0.006
_FOOTING: Final = 0.002
"""Least margin of a centre of mass within its support polygon, metres."""
OVERLAP: Final = -0.0005
"""Gap between outlines below which they overlap, metres: settled contacts are less deep."""
_STILL: Final = 0.05
_TILTED: Final = math.radians(5)
"""Targets with a smaller tilt count as upright: programs compute them from settled poses."""
_GRAIN: Final = 0.02
"""Objects no larger than this lie as they fall: any side will do, metres."""


def supporting_object_ids(number: int, scene: PlanningScene) -> set[int]:
    """Ids of the objects whose top carries an object's underside; empty on the bare table."""
    parts = scene.collider_prisms(number)
    low = min((prism.low for prism in parts), default=0.0)
    feet = [prism for prism in parts if prism.low < low + _TOUCHING]
    return {
        prism.owner
        for prism in scene.prisms_of_other_objects(number)
        if any(
            abs(foot.low - prism.high) < _TOUCHING
            and signed_outline_gaps(foot.outline, prism.outline, _POINT)[0] < OVERLAP
            for foot in feet
        )
    }


def carried_object_ids(number: int, scene: PlanningScene) -> list[int]:
    """Ids of the objects that rest on or in an object, at least partly."""
    base = scene.object_prism(number)
    above = [prism for prism in map(scene.object_prism, scene.object_ids) if prism.low > base.low + _TOUCHING]
    near = find_nearby_prisms(base, above, (0.0, 0.0), 0.0)
    return [prism.owner for prism in near if number in supporting_object_ids(prism.owner, scene)]


def enclosing_object_ids(number: int, scene: PlanningScene) -> set[int]:
    """Ids of the objects around an object that stands on the table within their outline, as in a fixture or ring."""
    body = scene.object_prism(number)
    return {
        other
        for other in scene.object_ids
        if body.low < _TOUCHING
        and other != number
        and scene.object_model(other).colliders
        and scene.object_prism(other).low < body.high
        and scene.object_prism(other).high > body.low
        and scene.is_point_over_object(other, scene.object_pose(number)[0])
    }


def mark_ids_under_object(number: int, scene: PlanningScene) -> set[int]:
    """Ids of the marks on the table under an object; empty if it is not on the table."""
    if scene.object_prism(number).low > _TOUCHING:
        return set()
    return {
        other
        for other in scene.object_ids
        if not scene.object_model(other).colliders
        and abs(scene.object_prism(other).high) < _TOUCHING
        and scene.is_point_over_object(other, scene.object_pose(number)[0])
    }


def is_placement_stable(parts: Sequence[Prism], height: float, center: FloatArray, others: Iterable[Prism]) -> bool:
    """Whether a body with its underside at a height (m) has its centre of mass (2,) within the support polygon."""
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


def has_toppled(number: int, scene: PlanningScene, tolerance: float) -> bool:
    """Whether an object's tilt grew by more than ``tolerance`` rad since the start; balls and grains never topple."""
    return (
        not cannot_topple(number, scene) and scene.object_tilt(number) > scene.object_tilt_at_start(number) + tolerance
    )


def is_target_tilted(target: Pose) -> bool:
    """Whether a target pose is tilted on purpose, not upright."""
    return tilt_of_pose(target) > _TILTED


def cannot_topple(number: int, scene: PlanningScene) -> bool:
    """Whether an object has no upright side: a ball, or a grain."""
    model = scene.object_model(number)
    return all(shape.kind == "sphere" for shape in model.colliders) or max(model.size) <= _GRAIN


def describe_tilt(number: int, scene: PlanningScene) -> str:
    """Tilt of an object in words."""
    now, start = math.degrees(scene.object_tilt(number)), math.degrees(scene.object_tilt_at_start(number))
    return f"it is tilted by {now:.0f} degrees, at the start by {start:.0f}"


def make_oracle_stop(outcome: Outcome, detail: str, scene: PlanningScene, *numbers: int) -> Stop:
    """A stop of the oracle that concerns objects; the detail adds those that have tipped over, a likely cause."""
    tipped = [
        f"; {scene.object_label(number)} has tipped over: {describe_tilt(number, scene)}"
        for number in numbers
        if has_toppled(number, scene, ROTATION_TOLERANCE)
    ]
    return Stop(outcome, detail + "".join(tipped), tuple(dict.fromkeys(map(scene.object_name, numbers))))


STAYS: Final = "must stay where the photo shows it"
"""The reason why a task may not move an object that it does not name."""


def describe_unmovables(numbers: Iterable[int], scene: PlanningScene) -> str:
    """Objects that the robot may not move, in words with the reasons."""
    owners = list(dict.fromkeys(numbers))
    staying = [scene.object_label(number) for number in owners if scene.is_bystander(number)]
    fixed = [scene.object_label(number) for number in owners if not scene.is_bystander(number)]
    reasons = ((staying, STAYS), (fixed, "is fixed"))
    return "; ".join(f"{' and '.join(labels)}, which {reason}" for labels, reason in reasons if labels)


def is_at_rest(number: int, scene: PlanningScene) -> bool:
    """Whether an object is at rest and released by the robot."""
    return scene.physics.held_object_id != number and scene.physics.object_speed(number) < _STILL
