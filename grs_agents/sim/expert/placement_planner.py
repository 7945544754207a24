"""The oracle's choice of where things go: to a goal's target, or out of the way."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from grs_agents.base import Pose
from grs_agents.base.geometry import transforms
from grs_agents.sim.expert.pose_placement import choose_pose_target
from grs_agents.sim.expert.relation_placement import RelationPlanner
from grs_agents.sim.expert.zone_packing import find_occupied_zone_target, pack_objects_into_zone, unplaced_zone_members
from grs_agents.sim.goals.scene_view import SceneView
from grs_agents.sim.goals.task_accounting import ScoredTask
from grs_agents.sim.instance.goal import Goal, Zone
from grs_agents.sim.motion.placement import (
    BlockedTarget,
    ReachTest,
    Region,
    Spot,
    Target,
    find_free_spot,
    rotated_outline_at_origin,
    wrap_angle,
)
from grs_agents.sim.world.footprints import Prism, rest_heights_at_offsets

_CLIMB: Final = 0.012
"""What is put aside comes to rest no more than this above where it was: never on top of its neighbours, metres."""


@dataclass(frozen=True)
class PlannedSpot:
    """A spot, and where its object was when it was chosen: the turn is relative to that."""

    spot: Spot
    pose: Pose


class Planner:
    """Chooses targets; remembers how the objects of a zone are to lie together."""

    def __init__(self) -> None:
        self._plans: dict[Zone, dict[int, PlannedSpot]] = {}
        self._relations = RelationPlanner()

    def choose_target(self, goal: Goal, row: int, task: ScoredTask, view: SceneView, lift: float) -> Target:
        """Where the object of one row of a goal should go, or why nowhere; it may share a zone with later goals.

        ``lift`` is from the object's lowest point to where the cup holds it, metres.
        """
        if goal.relation is not None:
            return self._relations.choose_target(goal, row, task, view, lift)
        if goal.metric == "pose":
            return choose_pose_target(goal, row, task, view, lift)
        return self._choose_zone_target(goal, row, task, view, lift)

    def goal_rows_to_move(self, goal: Goal, view: SceneView) -> list[int]:
        """Rows of a ``stacked`` or ``aligned`` goal whose objects must move, in the order in which they must."""
        return self._relations.goal_rows_to_move(goal, view)

    def _choose_zone_target(self, goal: Goal, row: int, task: ScoredTask, view: SceneView, lift: float) -> Target:
        number, reasons = goal.objects[row], list[Target]()
        for zone in goal.zones:
            planned = self._plans.get(zone, {}).get(number)
            if planned is not None and _is_plan_valid(planned, number, view, lift):
                return planned.spot
            members = unplaced_zone_members(zone, task)
            plan = pack_objects_into_zone(zone, [number, *(other for other in members if other != number)], view, lift)
            self._plans[zone] = {member: PlannedSpot(spot, view.object_pose(member)) for member, spot in plan.items()}
            if number in plan:
                return plan[number]
            reasons.append(find_occupied_zone_target(zone, number, members, task, view, lift))
        blocked = [reason for reason in reasons if isinstance(reason, Spot | BlockedTarget)]
        return blocked[0] if blocked else reasons[0]


def _is_plan_valid(planned: PlannedSpot, number: int, view: SceneView, lift: float) -> bool:
    """Whether the object has not been stirred since it was planned for, and its spot is still free."""
    pose, spot = view.object_pose(number), planned.spot
    if (
        float(np.abs(np.subtract(pose[0], planned.pose[0])).max()) > 0.003
        or abs(wrap_angle(transforms.yaw_of_quaternion(pose[1]) - transforms.yaw_of_quaternion(planned.pose[1]))) > 0.03
    ):
        return False
    shape = rotated_outline_at_origin(view.object_prism(number), np.asarray(pose[0][:2]), spot.turn)
    offset = np.array([spot.center])
    height = rest_heights_at_offsets(shape, view.prisms_of_other_objects(number), offset, 0.001)
    return bool(abs(height[0] - spot.height) < 0.01 and ReachTest(lift, view.arm)(offset, height)[0])


def find_spot_aside(number: int, keep_free: Sequence[Prism], view: SceneView, lift: float) -> Spot | None:
    """A spot out of the way, near where the object is: within what it stands in if there is room, else on the table."""
    body, center = view.object_prism(number), view.object_pose(number)[0]
    reserved = [Prism(prism.outline, 0.0, 1.0) for prism in (*keep_free, *_areas_reserved_by_goals(view, number))]
    holders = _enclosing_containers(number, view)
    taken = [*view.obstacles_to_plan_around([number], holders), *reserved]
    wanted = [
        view.object_prism(other) for other in view.object_ids if other != number and _may_receive_objects(other, view)
    ]
    unmarked = [*taken, *(Prism(mark.outline, 0.0, 1.0) for mark in wanted)]
    (x0, x1), (y0, y1), _ = view.bounds.tolist()
    table = _region_from_bounds(x0, y0, x1, y1)
    tries = [(_region_from_bounds(*view.object_prism(holder).bounding_box_xy), 0.003, taken) for holder in holders]
    for region, gap, obstacles in (*tries, (table, 0.03, unmarked), (table, 0.01, unmarked)):
        turns, suits = [0.0, np.pi / 2, np.pi / 4], ReachTest(lift, view.arm)
        spot = find_free_spot(body, center, turns, region, obstacles, gap, suits, spread=True, near=center)
        if spot is not None and spot.height <= max(body.low, 0.0) + _CLIMB:
            return spot
    return None


def _may_receive_objects(number: int, view: SceneView) -> bool:
    """Whether goals put things onto it or into it: a mark on the table, or something hollow."""
    return not view.object_model(number).colliders or view.is_object_hollow(number)


def _enclosing_containers(number: int, view: SceneView) -> list[int]:
    """Ids of the containers that an object stands in."""
    center = view.object_pose(number)[0]
    return [
        other
        for other in view.object_ids
        if other != number and view.is_object_hollow(other) and view.is_point_over_object(other, center)
    ]


def _region_from_bounds(x0: float, y0: float, x1: float, y1: float) -> Region:
    return Region(((x0 + x1) / 2, (y0 + y1) / 2), (x1 - x0, y1 - y0), 0.0)


def _areas_reserved_by_goals(view: SceneView, number: int) -> list[Prism]:
    """Where unmet pose goals want other objects, kept free."""
    areas: list[Prism] = []
    for goal in view.open_goals:
        for other in goal.objects if goal.metric == "pose" else ():
            center = np.asarray(view.object_pose(other)[0][:2])
            for target in goal.targets if other != number else ():
                shape = rotated_outline_at_origin(
                    view.object_prism(other), center, transforms.yaw_of_quaternion(target[1]) - view.object_yaw(other)
                )
                areas.append(Prism(shape.outline + np.asarray(target[0][:2]), 0.0, 1.0))
    return areas
