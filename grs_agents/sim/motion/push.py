"""The pushing primitive: the spatula comes down behind a pose, moves straight along the table, and lifts."""

from dataclasses import dataclass
from typing import Final

import numpy as np

from grs_agents.base import Pose, Vec3
from grs_agents.base.geometry import transforms
from grs_agents.base.geometry.transforms import FloatArray
from grs_agents.sim.arms.joint_paths import trapezoidal_profile
from grs_agents.sim.hands.spatula import BLADE_THICKNESS, BLADE_WIDTH
from grs_agents.sim.motion.arm_motion import FREE_SPEED, ArmMotion
from grs_agents.sim.motion.placement import format_point, wrap_angle
from grs_agents.sim.motion.tool_paths import ToolPose

HEIGHT: Final = 0.005
BEFORE: Final = 0.02
SHORT: Final = 0.05
"""Height of the tip, and its distance before ``pose0`` and short of ``pose1``, metres, as published."""
_SPEED: Final = 0.30
_RAMP: Final = 0.12
"""Duration of the ramps of a stroke, seconds: gentler than friction, so that nothing slides on."""
_ABOVE: Final = 0.06
_MOVED: Final = 0.01
"""Least displacement of a pushed object, metres; less is a mere touch."""


@dataclass(frozen=True)
class PushResult:
    """Outcome of a push."""

    pushed: tuple[int, ...]  # ids of the displaced objects, farthest first
    note: str  # a clause; "pushed" on success


def stroke_endpoints(pose0: Pose, pose1: Pose) -> tuple[FloatArray, FloatArray] | None:
    """Start and end (3,) of the tip, metres; None for poses too close to each other for any push."""
    start, end = np.array([*pose0[0][:2], HEIGHT]), np.array([*pose1[0][:2], HEIGHT])
    length = float(np.linalg.norm(end - start))
    if length + BEFORE - SHORT < 0.001:
        return None
    along = (end - start) / length
    return start - BEFORE * along, end - SHORT * along


def action_points_for_stroke(start: FloatArray, end: FloatArray) -> tuple[Vec3, Vec3]:
    """Positions of ``pose0`` and ``pose1`` for a stroke of the tip from ``start`` to ``end`` (2,), metres."""
    along = (end - start) / np.linalg.norm(end - start)
    first, last = start + BEFORE * along, end + SHORT * along
    return (float(first[0]), float(first[1]), HEIGHT), (float(last[0]), float(last[1]), HEIGHT)


class Push(ArmMotion):
    """Pushes with the spatula."""

    def push(self, pose0: Pose, pose1: Pose) -> PushResult:
        """Lower the blade behind ``pose0``, move it straight towards ``pose1``, and lift it."""
        way = stroke_endpoints(pose0, pose1)
        if way is None:
            return PushResult((), f"pose0 and pose1 are less than {SHORT - BEFORE:.2f} m apart, that pushes nothing")
        physics = self.physics
        before = {number: physics.object_pose(number)[0] for number in physics.world.addresses}
        note = self._execute_stroke(*way)
        ways = ((number, np.subtract(physics.object_pose(number)[0], start)) for number, start in before.items())
        moved = {number: float(np.linalg.norm(way)) for number, way in ways}
        pushed = sorted((number for number in moved if moved[number] > _MOVED), key=lambda number: -moved[number])
        return PushResult(tuple(pushed), note)

    def _execute_stroke(self, start: FloatArray, end: FloatArray) -> str:
        """Do a stroke. Returns: the note of its result."""
        physics, points = self.physics, straight_tip_path(self.physics.timestep, start, end)
        yaw = None
        if self.arm.reachable_mask(np.array([start, end])).all():
            least = wrap_angle(float(np.arctan2(end[1] - start[1], end[0] - start[0])) - self.yaw, np.pi)
            # strokes in the same sense wind the wrist up to its limit, so the next best turns are tried too
            for turn in sorted((least + half * np.pi for half in range(-2, 3)), key=abs):
                turned = self.yaw + turn
                above = self._stroke_start_poses(start, turned)[1]
                path = self.arm.solve_ik_tool_down(
                    points, np.full(len(points), turned), physics.commanded_joint_positions
                )
                radius = BLADE_WIDTH / 2 + BLADE_THICKNESS
                if self.arm.is_path_within_limits(path) and self._travel_over_obstacles(
                    above, radius, 0.0, self.obstacles, FREE_SPEED
                ):
                    yaw = turned
                    break
        if yaw is None:
            return f"the arm cannot reach {format_point(transforms.to_vec3(start))} with the tool down{self._hindrance}"
        low, high = self._stroke_start_poses(start, yaw)
        self._descend_until(high, low, lambda: bool(physics.objects_touching_cup()))
        under = sorted(physics.objects_touching_cup())
        if under and physics.tip_position[2] > HEIGHT + 0.004:
            self._retreat_upwards()
            return f"the blade came down on {self.names[under[0]]} at {format_point(transforms.to_vec3(start))}"
        path = self.arm.solve_ik_tool_down(points, np.full(len(points), yaw), physics.commanded_joint_positions)
        if not self._is_joint_path_feasible(path):
            self._retreat_upwards()
            way = f"from {format_point(low.point)} to {format_point(transforms.to_vec3(end))}"
            return f"the arm cannot push on {way}{self._hindrance}"
        physics.follow_joint_path(path)
        physics.wait_for_joint_positions(path[-1])
        self._retreat_upwards()
        return "pushed"

    def _stroke_start_poses(self, start: FloatArray, yaw: float) -> tuple[ToolPose, ToolPose]:
        """Poses at the start of a stroke, and above it."""
        return ToolPose(transforms.to_vec3(start), yaw), ToolPose(
            transforms.to_vec3(start + np.array([0.0, 0.0, _ABOVE])), yaw
        )


def straight_tip_path(timestep: float, start: FloatArray, end: FloatArray) -> FloatArray:
    """Straight path (N, 3) of the tip from start to end (3,), metres, a row per time step."""
    length = float(np.linalg.norm(end - start))
    ramp = min(_RAMP, length / _SPEED)
    seconds = length / _SPEED + ramp
    return start + (end - start) * trapezoidal_profile(max(4, int(seconds / timestep) + 1), ramp / seconds)[:, None]
