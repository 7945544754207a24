"""Motions of the arm over the table: travel above obstacles, guarded descents, slow lifts from between neighbours."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Final

import numpy as np

from grs_agents.base import Vec3
from grs_agents.base.geometry.transforms import FloatArray
from grs_agents.sim.arms.joint_paths import WAYPOINT_STEPS
from grs_agents.sim.motion.placement import format_point
from grs_agents.sim.motion.tool_paths import (
    UNDER,
    Pace,
    Payload,
    ToolPose,
    average_direction_if_compatible,
    candidate_routes,
    choose_safe_pace,
    max_obstacle_height_along,
    measure_touching_neighbours,
    plan_joint_legs,
    split_into_yaw_and_tilt,
)
from grs_agents.sim.world.footprints import Prism
from grs_agents.sim.world.physics import Physics

FREE_SPEED: Final = 1.2
HELD_SPEED: Final = 0.8
TOUCH_SPEED: Final = 0.06
DRAWING_SPEED: Final = 0.1
_HIGHEST_DRAW: Final = 0.12
"""Largest rise of the slow lift between neighbours, metres."""
CLEARANCE: Final = 0.03
"""Height of travel above obstacles, metres."""
UP: Final[FloatArray] = np.array([0.0, 0.0, 1.0])
_RETREAT: Final = 0.06
"""Retreat of the empty hand, metres."""


@dataclass(frozen=True)
class Descent:
    """A guarded descent after a travel: its lowest pose, and the condition that ends it sooner."""

    lowest: ToolPose
    stop: Callable[[], bool]
    speed: float = TOUCH_SPEED  # m/s


class ArmMotion:
    """Motions of an arm with any hand, the tool down or tilted."""

    def __init__(self, physics: Physics, look: Callable[[], Sequence[Prism]], names: dict[int, str]) -> None:
        """``look`` returns the current prisms of all objects."""
        self.physics, self.look, self.names = physics, look, names
        self.obstacles = look()
        self.arm = physics.arm
        self.yaw, self.tilt = split_into_yaw_and_tilt(physics.tip_rotation())
        self._hindrance, self._descended = "", False

    def _payload(self, held: int) -> Payload | None:
        """Load whose inertia limits the pace; None for a hand that holds at any pace."""
        del held
        return None

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
            apart = here.shifted_by(UNDER * (UP + average_direction_if_compatible([away for _, away in beside])))
            self._follow_tool_poses((here, apart, apart.shifted_by(rise * UP)), DRAWING_SPEED)
            self.obstacles = self.look()

    def _retreat_upwards(self, height: float = _RETREAT) -> None:
        here = self._current_tool_pose()
        self._follow_tool_poses((here, here.shifted_by(height * UP)), FREE_SPEED)
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
        clearance: float = CLEARANCE,
        descent: Descent | None = None,
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
            beyond = next((point for point in way if not self.arm.can_reach_point(point)), None)
            if beyond is not None and not self._hindrance:
                self._hindrance = f": it does not reach {format_point(beyond)}, over what stands on the way"
        return False

    def _follow_tool_poses(self, poses: Sequence[ToolPose], speed: float, descent: Descent | None = None) -> bool:
        """Follow straight legs, then a descent from their end if the arm can go all of it (``_descended``).

        Returns: False, without moving, if the arm cannot follow them or would hit the table or itself.
        """
        physics, held, self._descended = self.physics, self.physics.held_object_id, False
        payload = None if held is None else self._payload(held)
        gaits = list[Pace]()
        for start, end in pairwise(poses):
            length = math.dist(start.point, end.point)
            level = math.dist(start.point[:2], end.point[:2]) / length if length > 1e-6 else 1.0
            gaits.append(choose_safe_pace(speed, payload, physics.waypoint_seconds, level))
        legs = None
        if descent is not None:
            legs = self._plan_legs((*poses, descent.lowest), (*gaits, self._feeling_pace(descent.speed)))
            self._descended = legs is not None
        if legs is None and (legs := self._plan_legs(poses, gaits)) is None:
            return False
        stop = descent.stop if descent is not None and self._descended else None
        ended = physics.follow_joint_path(*legs, stop=stop, spacing=WAYPOINT_STEPS)
        if physics.held_object_id != held:
            self.yaw, self.tilt = split_into_yaw_and_tilt(physics.tip_rotation())
            return False
        if not ended:
            physics.wait_for_joint_positions(legs[-1][-1])
        self.yaw, self.tilt = poses[-1].yaw, poses[-1].tilt
        return True

    def _descend_until(self, start: ToolPose, end: ToolPose, stop: Callable[[], bool]) -> None:
        """Descend with guarded motion until ``stop``; the arm does not move if it cannot go all of the way."""
        if (legs := self._plan_legs((start, end), (self._feeling_pace(),))) is not None:
            self.physics.follow_joint_path(*legs, stop=stop, spacing=WAYPOINT_STEPS)

    def _feeling_pace(self, speed: float = TOUCH_SPEED) -> Pace:
        """Pace of guarded motion."""
        return Pace(speed, 0.0, self.physics.waypoint_seconds, even=True)

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
