"""The pick-and-place primitive: suction gated on contact and seal, placing until contact, typed failure."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Final

import numpy as np

from grs_agents.base import Pose, Vec3
from grs_agents.base.geometry import transforms
from grs_agents.base.geometry.transforms import FloatArray
from grs_agents.sim.arms.arm_parts import CUP_RADIUS
from grs_agents.sim.arms.joint_paths import WAYPOINT_STEPS
from grs_agents.sim.instance.episode import Outcome
from grs_agents.sim.motion import grasp
from grs_agents.sim.motion.placement import format_point
from grs_agents.sim.motion.tool_paths import (
    UNDER,
    Pace,
    Payload,
    ToolPose,
    average_direction_if_compatible,
    candidate_routes,
    choose_safe_pace,
    interpolate_upright,
    max_obstacle_height_along,
    measure_touching_neighbours,
    plan_joint_legs,
    smoothstep,
    split_into_yaw_and_tilt,
    tool_up_axis,
)
from grs_agents.sim.world.footprints import Prism
from grs_agents.sim.world.physics import Physics

FREE_SPEED: Final = 1.2
HELD_SPEED: Final = 0.8
TOUCH_SPEED: Final = 0.06
DRAWING_SPEED: Final = 0.1
_HIGHEST_DRAW: Final = 0.12
"""Largest rise of the slow lift between neighbours, metres."""
_CLEARANCE: Final = 0.03
ROPE_SPEED: Final = 0.2
_ROPE_CLEARANCE: Final = 0.01
"""Tied objects are dragged, slowly and low, rather than carried, so that they do not swing."""
_LOWEST: Final = 0.001
_PRESSED: Final = 0.0005
"""Lowest height of the tip, and its least depth below the pick point, metres: the 1 mm floor of a fixture, settled into
the table, lies lower than ``_LOWEST``."""
_UP: Final[FloatArray] = np.array([0.0, 0.0, 1.0])
_ABOVE_TILTED: Final = 0.05
"""Length of the approach along the tool to a tilted place, metres: a vertical approach would hit the walls."""
_PEELING, _RETREAT = 0.02, 0.06
"""Retreat of the cup, along the tool and then up, metres."""
_BEARING: Final = 4
"""Time steps for a held object to load its support after the first contact."""
_LETTING_GO: Final = (8, 40)
"""Least and most time steps that the cup waits for a released object to rest: once all bodies sleep, the arm retreats
without the dynamics."""
_TURNS: Final = tuple(turn * np.pi / 2 for turn in (0, 1, -1, 2, -2, 3, -3, 4, -4))
"""Turns of the tool before the pick that are tried, so that the wrist can then make the turn to the place."""


@dataclass(frozen=True)
class PickPlaceResult:
    """Outcome of a pick-and-place."""

    grasped: int | None  # id of the picked object
    placed: bool  # brought to the place pose and released there
    note: str  # a clause; "placed" on success
    trouble: Outcome | None = None  # kind of the failure in the note, if it has a name


@dataclass(frozen=True)
class _Descent:
    """A guarded descent after a travel: its lowest pose, and the condition that ends it sooner."""

    lowest: ToolPose
    stop: Callable[[], bool]


class PickPlaceMotion:
    """Picks with the suction cup, tool down, and places, with the tool tilted if the poses ask for it."""

    def __init__(self, physics: Physics, look: Callable[[], Sequence[Prism]], names: dict[int, str]) -> None:
        """``look`` returns the current prisms of all objects."""
        self.physics, self.look, self.names = physics, look, names
        self.obstacles = look()
        self.arm = physics.arm
        self.yaw, self.tilt = split_into_yaw_and_tilt(physics.suction_tip_rotation())
        self._hindrance, self._descended = "", False

    def pick_and_place(self, pick: Pose, place: Pose) -> PickPlaceResult:
        """Pick at the first contact of the cup, and place with the cup lowered at its place pose until contact.
        The held object is turned and tilted by the rotation from ``pick`` to ``place``."""
        back = transforms.invert_pose(((0, 0, 0), pick[1]))[1]
        between = transforms.multiply_quaternions(transforms.to_unit_quaternion(place[1]), back)
        turn, tilt = split_into_yaw_and_tilt(between)
        ready = self._choose_pick_yaw(transforms.to_vec3(pick[0]), transforms.to_vec3(place[0]), turn)
        picked = self._pick_object(transforms.to_vec3(pick[0]), ready)
        if picked.grasped is None:
            return picked
        return self._place_object(picked.grasped, ToolPose(transforms.to_vec3(place[0]), self.yaw + turn, tilt))

    def pick_and_lift(self, pick: Pose, height: float) -> PickPlaceResult:
        """Pick at the first contact of the cup, and lift by ``height`` (m); ``placed`` if the object hangs there."""
        point = transforms.to_vec3(pick[0])
        picked = self._pick_object(point, self._choose_pick_yaw(point, point, 0.0))
        if picked.grasped is None:
            return picked
        self._lift_clear_of_neighbours(picked.grasped)
        here = self._current_tool_pose()
        self._follow_tool_poses((here, here.shifted_by(height * _UP)), HELD_SPEED)
        if self.physics.held_object_id == picked.grasped:
            return PickPlaceResult(picked.grasped, True, "lifted")
        return PickPlaceResult(picked.grasped, False, self._describe_drop(picked.grasped), "dropped")

    def _choose_pick_yaw(self, pick: Vec3, place: Vec3, turn: float) -> float:
        """Yaw of the tool for the pick with which the wrist's limits allow the turn to the place afterwards."""
        tip, seed = self.physics.tip_position, self.physics.commanded_joint_positions
        height = max(tip[2], pick[2], place[2])
        stops = [(x, y, height) for x, y, _ in (tip, pick, place)]
        for first in _TURNS:
            turned = (self.yaw, self.yaw + first, self.yaw + first + turn)
            shares = [smoothstep(4 + int(2 * abs(angle))) for angle in (first, turn)]
            points, yaws = interpolate_upright(list(map(ToolPose, stops, turned)), shares)
            if self.arm.is_path_within_limits(self.arm.solve_ik_tool_down(points, yaws, seed)):
                return self.yaw + first
        return self.yaw

    def _pick_object(self, point: Vec3, yaw: float) -> PickPlaceResult:
        """Descend to a point and take hold of the object there."""
        physics = self.physics
        near = ToolPose((point[0], point[1], point[2] + 0.008), yaw)
        lowest = ToolPose((point[0], point[1], max(min(_LOWEST, point[2] - _PRESSED), point[2] - 0.03)), yaw)
        aimed, met = physics.surface_height_below(*point[:2])[1], set[int]()
        physics.cup.fit_nozzle(physics.world.nozzle_for_object(aimed))

        def touches() -> bool:
            met.update(physics.unheld_objects_touching_robot())
            return bool(physics.objects_touching_cup())

        descent = _Descent(lowest, touches)
        if not self._travel_over_obstacles(near, CUP_RADIUS + 0.04, 0.0, self.obstacles, FREE_SPEED, descent=descent):
            return self._make_out_of_reach_result(point)
        if not self._descended:
            return self._make_out_of_reach_result(lowest.point)
        touched = grasp.find_touched_object(physics, aimed)
        if touched is None:
            if fixed := sorted(physics.objects_touching_cup()):
                note = f"{self.names[fixed[0]]}, which is fixed, at {format_point(point)}"
                return PickPlaceResult(None, False, note, "unreachable")
            if others := sorted(met - {aimed}):
                goal = f", to {self.names[aimed]}" if aimed >= 0 else ""
                names = " and ".join(self.names[other] for other in others)
                note = f"{names} is in the arm's way on its way down{goal} at {format_point(point)}"
                return PickPlaceResult(None, False, note, "hindered")
            return PickPlaceResult(None, False, f"nothing to grasp at {format_point(point)}")
        best, share = touched
        if share < grasp.SEALED:
            self._retreat_upwards()
            if aimed not in (best, -1):
                way = f"{self.names[best]} is in the cup's way, to {self.names[aimed]} at {format_point(point)}"
                return PickPlaceResult(None, False, way, "hindered")
            seal = f"{share:.0%} of its lip lies on it, it needs {grasp.SEALED:.0%}"
            note = f"the cup finds no seal on {self.names[best]} at {format_point(point)}: {seal}"
            return PickPlaceResult(None, False, note, "no_seal")
        physics.cup.grasp(best)
        return PickPlaceResult(best, False, "grasped")

    def _make_out_of_reach_result(self, point: Vec3) -> PickPlaceResult:
        note = f"the arm cannot reach {format_point(point)} with the tool down{self._hindrance}"
        return PickPlaceResult(None, False, note, "unreachable")

    def _place_object(self, grasped: int, place: ToolPose) -> PickPlaceResult:
        physics = self.physics
        up = tool_up_axis(place.tilt)
        tilted = bool(up[2] < 1.0)
        self._lift_clear_of_neighbours(grasped)
        tip = physics.tip_position
        held_prisms = [obstacle for obstacle in self.obstacles if obstacle.owner == grasped]
        radius, drop = 0.05, 0.0  # reach of the object from the tip to the side, and below it, m
        if held_prisms:
            radius = max(
                float(np.linalg.norm(prism.outline - np.asarray(tip[:2]), axis=1).max()) for prism in held_prisms
            )
            drop = max(0.0, tip[2] - min(prism.low for prism in held_prisms))
        near = place.shifted_by((_ABOVE_TILTED if tilted else 0.012) * up)
        deepest = max(drop - 0.01, place.point[2] - 0.25, _LOWEST)
        lowest = place.shifted_by(-0.03 * up) if tilted else ToolPose((*place.point[:2], deepest), place.yaw)
        descent = _Descent(lowest, lambda: physics.is_object_supported(grasped))
        limp = physics.world.limp
        tied = grasped in limp
        fellows = limp if tied else {grasped}
        others = [obstacle for obstacle in self.obstacles if obstacle.owner not in fellows]
        hanging = float(np.hypot(radius, drop)) if tilted else drop
        aside = (hanging if tilted else radius) + 0.01
        speed, clearance = (ROPE_SPEED, _ROPE_CLEARANCE) if tied else (HELD_SPEED, _CLEARANCE)
        if not self._travel_over_obstacles(near, aside, hanging, others, speed, clearance, descent):
            if physics.held_object_id is None:
                note = self._describe_drop(grasped)
                self._retreat_upwards()
                return PickPlaceResult(grasped, False, note, "dropped")
            here, held = self._current_tool_pose(), physics.held_object_id
            lower = here.shifted_by(np.array([0.0, 0.0, -0.02]))
            self._descend_until(here, lower, lambda: physics.is_object_supported(held))
            self._release_and_retreat(_UP)
            how = f"over its neighbours to {format_point(place.point)}" + (" so tilted" if tilted else "")
            note = f"the arm cannot carry {self.names[grasped]} {how}{self._hindrance}"
            return PickPlaceResult(grasped, False, note, "unreachable")
        physics.step(_BEARING)
        kept = physics.held_object_id == grasped
        self._release_and_retreat(up)
        if kept:
            return PickPlaceResult(grasped, True, "placed")
        return PickPlaceResult(grasped, False, self._describe_drop(grasped), "dropped")

    def _lift_clear_of_neighbours(self, number: int) -> None:
        """Lift an object slowly from between its neighbours, a little away from them, until clear, and look again.

        Contact friction drags neighbours along, the more the faster the lift, or breaks the seal of the cup.
        """
        if number in self.physics.world.limp:
            return
        beside = measure_touching_neighbours(number, self.obstacles)
        if beside:
            rise = min(max(height for height, _ in beside) + UNDER, _HIGHEST_DRAW)
            here = self._current_tool_pose()
            apart = here.shifted_by(UNDER * (_UP + average_direction_if_compatible([away for _, away in beside])))
            self._follow_tool_poses((here, apart, apart.shifted_by(rise * _UP)), DRAWING_SPEED)
            self.obstacles = self.look()

    def _describe_drop(self, number: int) -> str:
        name, slip, nozzle = self.names[number], self.physics.cup.slip, self.physics.cup.nozzle
        if slip is None or slip.number != number:
            return f"{name} was dropped on the way"
        weight, touched = self.physics.object_mass(number), sorted(self.physics.objects_touching_object(number))
        hit = f" as it hit {' and '.join(self.names[other] for other in touched)}" if touched else ""
        how = f"slipped off the cup: {slip.load:.3g} N pulled, it holds {nozzle.holding_force:.3g} N"
        if slip.load <= nozzle.holding_force:
            how = f"tipped off the cup: {slip.moment:.2g} N m bent it, it bears {nozzle.peeling_moment:.2g} N m"
        return f"{name} ({weight:.2g} kg) {how}{hit}"

    def _release_and_retreat(self, up: FloatArray) -> None:
        self.physics.cup.release(collides=False)
        self.physics.wait_until_asleep(*_LETTING_GO)
        if up[2] < 1.0:
            here = self._current_tool_pose()
            self._follow_tool_poses((here, here.shifted_by(_PEELING * up)), 0.2)
            self._retreat_upwards()
        else:
            self._retreat_upwards(_PEELING + _RETREAT)
        self.physics.cup.restore_collisions()

    def _retreat_upwards(self, height: float = _RETREAT) -> None:
        here = self._current_tool_pose()
        self._follow_tool_poses((here, here.shifted_by(height * _UP)), FREE_SPEED)
        self.physics.simulate_until_at_rest()

    def _current_tool_pose(self) -> ToolPose:
        return ToolPose(self.physics.tip_position, self.yaw, self.tilt)

    def _travel_over_obstacles(
        self,
        end: ToolPose,
        radius: float,
        drop: float,
        obstacles: Sequence[Prism],
        speed: float,
        clearance: float = _CLEARANCE,
        descent: _Descent | None = None,
    ) -> bool:
        """Travel over the table to a pose and down to it, each leg just above the obstacles within ``radius`` (m).

        ``drop`` (m) is the reach of the held object below the cup. ``descent`` follows at once if the arm can go all
        of it. Returns: False if there is no route (the arm has not moved) or the cup let go, where the arm stops.
        """
        tip, held, self._hindrance = self._current_tool_pose().point, self.physics.held_object_id, ""
        for route in candidate_routes(tip, end.point):
            way: list[Vec3] = [tip]
            for start, stop in pairwise(route):
                height = max_obstacle_height_along(start, stop, radius, obstacles) + drop + clearance
                height = max(height, end.point[2] if stop == end.point else 0.0, tip[2] + 0.02 if drop else 0.0)
                way += [(start[0], start[1], height), (stop[0], stop[1], height)]
            points = (*way, end.point)
            legs = np.diff([point[:2] for point in points], axis=0)
            turn = 1 + int(np.argmax([float(np.linalg.norm(leg)) for leg in legs]))  # the tool turns on the longest leg
            poses = [
                ToolPose(point, end.yaw, end.tilt) if index >= turn else ToolPose(point, self.yaw, self.tilt)
                for index, point in enumerate(points)
            ]
            if self._follow_tool_poses(poses, speed, descent):
                return True
            if self.physics.held_object_id != held:
                return False
        return False

    def _follow_tool_poses(self, poses: Sequence[ToolPose], speed: float, descent: _Descent | None = None) -> bool:
        """Follow straight legs, then a descent from their end if the arm can go all of it (``_descended``).

        Returns: False, without moving, if the arm cannot follow them or would hit the table or itself.
        """
        physics, held, self._descended = self.physics, self.physics.held_object_id, False
        payload = None
        if held is not None:  # as the cup feels it, the tool down
            x, y, z = np.subtract(physics.center_of_mass(held), physics.tip_position).tolist()
            nozzle = physics.world.nozzle_for_object(held)
            payload = Payload(physics.object_mass(held), float(np.hypot(x, y)), max(0.0, -z), nozzle)
        gaits = list[Pace]()
        for start, end in pairwise(poses):
            length = math.dist(start.point, end.point)
            level = math.dist(start.point[:2], end.point[:2]) / length if length > 1e-6 else 1.0
            gaits.append(choose_safe_pace(speed, payload, physics.waypoint_seconds, level))
        legs = None
        if descent is not None:
            legs = self._plan_legs((*poses, descent.lowest), (*gaits, self._feeling_pace))
            self._descended = legs is not None
        if legs is None and (legs := self._plan_legs(poses, gaits)) is None:
            return False
        stop = descent.stop if descent is not None and self._descended else None
        ended = physics.follow_joint_path(*legs, stop=stop, spacing=WAYPOINT_STEPS)
        if physics.held_object_id != held:
            self.yaw, self.tilt = split_into_yaw_and_tilt(physics.suction_tip_rotation())
            return False
        if not ended:
            physics.wait_for_joint_positions(legs[-1][-1])
        self.yaw, self.tilt = poses[-1].yaw, poses[-1].tilt
        return True

    def _descend_until(self, start: ToolPose, end: ToolPose, stop: Callable[[], bool]) -> None:
        """Descend with guarded motion until ``stop``; the arm does not move if it cannot go all of the way."""
        if (legs := self._plan_legs((start, end), (self._feeling_pace,))) is not None:
            self.physics.follow_joint_path(*legs, stop=stop, spacing=WAYPOINT_STEPS)

    @property
    def _feeling_pace(self) -> Pace:
        """Pace of guarded motion."""
        return Pace(TOUCH_SPEED, 0.0, self.physics.waypoint_seconds, even=True)

    def _plan_legs(self, poses: Sequence[ToolPose], gaits: Sequence[Pace]) -> list[FloatArray] | None:
        """Waypoints (K, dof) of each leg between two poses; None if the arm cannot follow them all."""
        legs = plan_joint_legs(self.arm, poses, gaits, self.physics.commanded_joint_positions)
        return legs if self._is_joint_path_feasible(np.concatenate(legs)) else None

    def _is_joint_path_feasible(self, path: FloatArray) -> bool:
        """Whether the arm can follow joint positions (N, dof): within limits, clear of the table and of itself."""
        if not self.arm.is_path_within_limits(path):
            return False
        gap = self.arm.first_collision_along(path)
        if gap is not None:
            self._hindrance = f": {gap}"
        return gap is None
