"""Pick and place with two fingers: real contact while the hand closes, lifts, sets down and opens."""

import math
from collections.abc import Callable, Sequence
from typing import Final

import numpy as np

from grs_agents.base import Pose
from grs_agents.base.geometry import transforms
from grs_agents.base.geometry.transforms import FloatArray
from grs_agents.sim.arms.arm_parts import DOWN
from grs_agents.sim.hands.hand import ROBOT_CONTYPE
from grs_agents.sim.motion import finger_grasps
from grs_agents.sim.motion.arm_motion import CLEARANCE, FREE_SPEED, HELD_SPEED, UP, ArmMotion, Descent
from grs_agents.sim.motion.hand_room import HandRoom
from grs_agents.sim.motion.pick_place import PickPlaceResult
from grs_agents.sim.motion.placement import format_point
from grs_agents.sim.motion.tool_paths import ToolPose, rotations_from_rotvecs, split_into_yaw_and_tilt, tool_up_axis
from grs_agents.sim.world.footprints import Prism
from grs_agents.sim.world.physics import Physics

_APPROACH_SPEED: Final = 0.25
_LIFT_SPEED: Final = 0.15
"""Speeds of the straight approach along the hand, and of the first part of the lift, m/s."""
_LIFT: Final = 0.02
"""First part of the lift, metres: under the dynamics, so that what is not held stays behind."""
_SIDE: Final = 0.01
"""Clearance between an open pad and what it is to close on, metres."""
_NEAR: Final = 0.003
"""Distance from what they close on at which the fingers go on under the dynamics, metres."""
_LONGEST_CLOSING: Final = 100
"""Most time steps until both pads touch."""
_SQUEEZE: Final = 24
"""Time steps in which the gripping force builds up."""
_SETTLING: Final = (8, 60)
"""Least and most time steps that the open hand waits for a released object to rest."""
_BEARING: Final = 4
_WITHIN: Final = 0.006
"""Farthest that the tip may stop from a grasp that it was kept from, metres."""
_HEAD_ON: Final = 0.7
"""Least part of a contact's normal along the hand with which it keeps the hand from going on."""
_LOWEST: Final = 0.002
_DEEPER: Final = 0.25
"""Farthest that an object is lowered below its place until it meets its support, metres."""
_MOST_SHIFT: Final = 0.02
"""Farthest that a place is shifted for what moved between the fingers, metres."""
_ABOVE_PLACE: Final = 0.02
_ABOVE_TILTED: Final = 0.05
"""Lengths of the last, guarded part of the way to a place, metres."""
_HALF_TURNS: Final = (0.0, np.pi, -np.pi)
_Aim = tuple[int, float, float]
"""Id of an object between the pads, and its ends along the closing axis from the tip, metres."""


class FingerPickPlace(ArmMotion):
    """Picks what is between the pads at the pick pose, and places it by the motion from the pick to the place pose."""

    def __init__(self, physics: Physics, look: Callable[[], Sequence[Prism]], names: dict[int, str]) -> None:
        super().__init__(physics, look, names)
        self.fingers = physics.fingers
        self.hand = self.fingers.hand

    def pick_and_place(self, pick: Pose, place: Pose) -> PickPlaceResult:
        """Close on what is at the first pose, and open the hand at the second once the object stands.

        A pose with nothing between the fingers, as on top of an object, asks for the object below it: the hand takes
        that by a grasp of its own, and moves it by the same motion.
        """
        aimed = self._find_aimed_object(pick)
        if aimed is None:
            chosen = self._choose_own_grasp(pick, place)
            if isinstance(chosen, PickPlaceResult):
                return chosen
            pick, place = chosen
            aimed = self._find_aimed_object(pick)
        rise = self._rise_off_table(pick, aimed)
        pick, place = _raised(pick, rise), _raised(place, rise)
        poses = self._choose_half_turn(pick, place)
        if poses is None:
            return self._make_unreachable_result(pick)
        before = {number: self.physics.object_pose(number) for number in self.physics.world.addresses}
        picked = self._pick_object(pick, poses[0], aimed)
        if picked.grasped is None:
            return picked
        motion = transforms.compose_poses(place, transforms.invert_pose(pick))
        place = self._correct_for_hanging(picked.grasped, place, motion, before[picked.grasped])
        poses = poses[0], ToolPose(place[0], poses[1].yaw, poses[1].tilt)
        _, tilt = split_into_yaw_and_tilt(motion[1])
        return self._place_object(picked.grasped, poses[1], tool_up_axis(tilt))

    def _choose_own_grasp(self, pick: Pose, place: Pose) -> tuple[Pose, Pose] | PickPlaceResult:
        """Poses that take the object below a pose, and bring it where the motion to ``place`` does."""
        physics = self.physics
        number = physics.surface_height_below(*pick[0][:2])[1]
        if number not in physics.world.addresses:
            return PickPlaceResult(None, False, f"there is nothing to grasp at {format_point(pick[0])}")
        motion = transforms.compose_poses(place, transforms.invert_pose(pick))
        found = finger_grasps.find_finger_grasps(
            physics, HandRoom(physics), number, lambda hold: transforms.compose_poses(motion, hold)
        )
        if not found.grasps:
            return PickPlaceResult(None, False, found.why.format(name=self.names[number]), found.trouble)
        grasp = found.grasps[0].pose
        return grasp, transforms.compose_poses(motion, grasp)

    def pick_and_lift(self, pick: Pose, height: float) -> PickPlaceResult:
        """Pick, and lift by ``height`` (m); ``placed`` if the object hangs there."""
        aimed = self._find_aimed_object(pick)
        pick = _raised(pick, self._rise_off_table(pick, aimed))
        poses = self._choose_half_turn(pick, pick)
        if poses is None:
            return self._make_unreachable_result(pick)
        picked = self._pick_object(pick, poses[0], aimed)
        if picked.grasped is None:
            return picked
        here = self._current_tool_pose()
        self._follow_tool_poses((here, here.shifted_by(height * UP)), HELD_SPEED)
        if self.physics.held_object_id == picked.grasped:
            return PickPlaceResult(picked.grasped, True, "lifted")
        return PickPlaceResult(picked.grasped, False, self._describe_loss(picked.grasped), "dropped")

    def _correct_for_hanging(self, held: int, place: Pose, motion: Pose, before: Pose) -> Pose:
        """The place pose, shifted so that what is held now arrives where ``motion`` brings it, never lower.

        What the fingers close on moves a little between them, and a bowl taken by its rim tilts.
        """
        lever = np.subtract(self.physics.object_pose(held)[0], self.physics.tip_position)
        arrival = np.array(place[0]) + transforms.quaternion_to_matrix(motion[1]) @ lever
        shift = np.array(transforms.compose_poses(motion, before)[0]) - arrival
        if float(np.hypot(*shift[:2])) > _MOST_SHIFT:
            return place
        (x, y, z), rotation = place
        return (x + float(shift[0]), y + float(shift[1]), z + min(max(0.0, float(shift[2])), _MOST_SHIFT)), rotation

    def _choose_half_turn(self, pick: Pose, place: Pose) -> tuple[ToolPose, ToolPose] | None:
        """Tool poses of pick and place, turned half around where the wrist demands it; None if out of reach."""
        seed = self.physics.commanded_joint_positions
        rotation = transforms.to_unit_quaternion(pick[1])
        yaw, tilt = split_into_yaw_and_tilt(rotation)
        nearest = self.yaw + _wrap(yaw - self.yaw)
        last_yaw, last_tilt = split_into_yaw_and_tilt(transforms.to_unit_quaternion(place[1]))
        turn = _wrap(last_yaw - yaw)
        for half in sorted(_HALF_TURNS, key=lambda half: abs(nearest + half - self.yaw)):
            first = ToolPose(transforms.to_vec3(pick[0]), nearest + half, tilt)
            last = ToolPose(transforms.to_vec3(place[0]), nearest + half + turn, last_tilt)
            if self._reaches((_drawn_back(first), first, _drawn_back(last), last), seed):
                return first, last
        return None

    def _reaches(self, poses: Sequence[ToolPose], seed: FloatArray) -> bool:
        """Whether the arm comes from each pose to the next without winding a joint beyond its limit."""
        for pose in poses:
            rotation = _tool_rotation(pose)
            if any(pose.tilt):
                joints = self.arm.solve_ik_for_poses(np.array([pose.point]), rotation[None], seed)
            else:
                joints = self.arm.solve_ik_tool_down(np.array([pose.point]), np.array([pose.yaw]), seed)
            if not self.arm.is_path_within_limits(joints):
                return False
            seed = joints[0]
        return True

    def _make_unreachable_result(self, pick: Pose) -> PickPlaceResult:
        note = f"the arm cannot reach {format_point(pick[0])} with the hand so turned{self._hindrance}"
        return PickPlaceResult(None, False, note, "unreachable")

    def _pick_object(self, pick: Pose, ready: ToolPose, aimed: _Aim | None) -> PickPlaceResult:
        """Come to a grasp along the hand, close, and lift a little."""
        physics, fingers = self.physics, self.fingers
        axes = finger_grasps.hand_axes(pick)
        if aimed is None:
            return PickPlaceResult(None, False, f"there is nothing between the fingers at {format_point(pick[0])}")
        number, low, high = aimed
        opening = self._opening(low, high)
        fingers.force = self.hand.forces[1]  # whatever was held before
        fingers.set_width(opening)
        near = ready.shifted_by(-finger_grasps.RETREAT * axes[:, 2])
        descent = Descent(ready, self._is_blocked, _APPROACH_SPEED)
        around = max(block.half[1] for block in self.hand.palm)
        if not self._travel_over_obstacles(near, around, 0.0, self.obstacles, FREE_SPEED, descent=descent):
            return self._make_unreachable_result(pick)
        if not self._descended:
            return self._make_unreachable_result(pick)
        if math.dist(physics.tip_position, ready.point) > _WITHIN:
            met = [self.names[other] for other in sorted(physics.unheld_objects_touching_robot())]
            self._draw_back(axes)
            where = f"on the way to {self.names[number]} at {format_point(pick[0])}"
            note = f"the hand came down on {' and '.join(met) or 'something'} {where}"
            return PickPlaceResult(None, False, note, "hindered")
        self._close(number, opening)
        between = fingers.touched_objects()
        if not between:
            self._open(opening)
            self._draw_back(axes)
            return PickPlaceResult(None, False, f"the fingers closed beside {self.names[number]}", "no_grip")
        held = number if number in between else min(between)
        fingers.grasp(held)
        self._lift_a_little(held)
        if physics.held_object_id != held:
            note = self._describe_loss(held)
            self._open(opening)
            self._retreat_upwards()
            return PickPlaceResult(None, False, note, "no_grip")
        return PickPlaceResult(held, False, "grasped")

    def _find_aimed_object(self, pick: Pose) -> _Aim | None:
        """The movable object nearest to the middle between the open pads at a pose."""
        tip, axes = np.array(pick[0]), finger_grasps.hand_axes(pick)
        best: tuple[float, _Aim] | None = None
        for number in self.physics.world.addresses:
            ends = finger_grasps.measure_between_pads(self.physics, number, tip, axes)
            if ends is not None and (best is None or abs(sum(ends)) < best[0]):
                best = abs(sum(ends)), (number, *ends)
        return None if best is None else best[1]

    def _is_blocked(self) -> bool:
        """Whether the hand meets something head-on."""
        data, world = self.physics.data, self.physics.world
        if data.ncon == 0:
            return False
        pairs, axis = data.contact.geom, data.site_xmat[world.tip_site].reshape(3, 3)[:, 2]
        robot = (world.model.geom_contype[pairs] == ROBOT_CONTYPE).any(axis=1)
        along = np.abs(data.contact.frame[:, :3] @ axis)
        return bool((robot & (along > _HEAD_ON)).any())

    def _close(self, number: int, opening: float) -> None:
        """Close the fingers on an object, gently until both pads touch, then with the force that suits its mass.

        The finger that is first pushes the object: with more force it tips it, and snaps after it.
        """
        physics, fingers = self.physics, self.fingers
        tip, axes = np.array(physics.tip_position), self._current_axes()
        lever = abs(float(np.cross(physics.center_of_mass(number) - tip, axes[:, 1])[2]))  # about the pads' axis
        gentle, force = self.hand.gripping_force(0.0), self.hand.gripping_force(physics.object_mass(number), lever)
        ends = finger_grasps.measure_between_pads(physics, number, tip, axes)
        start = opening if ends is None else min(opening, 2 * (max(-ends[0], ends[1]) + _NEAR))
        step = 2 * self.hand.speed * physics.timestep * _PART
        start = fingers.narrow_to(start)
        physics.pass_time(_PART * math.ceil((opening - start) / step))
        for count in range(0, _LONGEST_CLOSING, _PART):
            fingers.command(max(0.0, start - step * (count // _PART + 1)), gentle, closing=True)
            physics.step(_PART)
            if fingers.pads_touching(number) == 2:
                break
        for share in np.linspace(0.0, 1.0, _SQUEEZE // _PART + 1)[1:].tolist():
            fingers.command(0.0, gentle + share * (force - gentle), closing=True)
            physics.step(_PART)

    def _lift_a_little(self, held: int) -> None:
        """Lift from the support, and from between neighbours, under the dynamics."""
        before = self.physics.tip_position[2]
        self._lift_clear_of_neighbours(held)
        if self.physics.tip_position[2] < before + _LIFT / 2:
            here = self._current_tool_pose()
            self._follow_tool_poses((here, here.shifted_by(_LIFT * UP)), _LIFT_SPEED)
        self.obstacles = self.look()

    def _place_object(self, grasped: int, place: ToolPose, up: FloatArray) -> PickPlaceResult:
        """Carry to a place, lower along ``up`` until the object is supported or the hand meets anything, and let go."""
        physics = self.physics
        tip = physics.tip_position
        held_prisms = [prism for prism in self.obstacles if prism.owner == grasped]
        radius = max(block.half[1] for block in self.hand.palm)
        reach, drop = radius, 0.0
        if held_prisms:
            outlines = np.concatenate([prism.outline for prism in held_prisms])
            reach = float(np.linalg.norm(outlines - np.asarray(tip[:2]), axis=1).max())
            drop = max(0.0, tip[2] - min(prism.low for prism in held_prisms))
        tilted = bool(up[2] < 1.0)
        hanging = float(np.hypot(reach, drop)) if tilted else drop
        near = place.shifted_by((_ABOVE_TILTED if tilted else _ABOVE_PLACE) * up)
        lowest = place.shifted_by(-0.03 * up) if tilted else self._lowest_place(place)
        others = [prism for prism in self.obstacles if prism.owner != grasped]
        descent = Descent(
            lowest, lambda: physics.is_object_supported(grasped) or bool(physics.unheld_objects_touching_robot())
        )
        aside = max(radius, hanging if tilted else reach) + 0.01
        if not self._travel_over_obstacles(near, aside, hanging, others, HELD_SPEED, CLEARANCE, descent):
            lost = physics.held_object_id is None
            note = self._describe_loss(grasped)
            if not lost:
                here = self._current_tool_pose()
                lower = here.shifted_by(np.array([0.0, 0.0, -0.03]))
                self._descend_until(here, lower, lambda: physics.is_object_supported(grasped))
                note = f"the arm cannot carry {self.names[grasped]} to {format_point(place.point)}{self._hindrance}"
            self._release()
            return PickPlaceResult(grasped, False, note, "dropped" if lost else "unreachable")
        physics.step(_BEARING)
        kept = physics.held_object_id == grasped
        note = "placed" if kept else self._describe_loss(grasped)
        self._release()
        return PickPlaceResult(grasped, kept, note, None if kept else "dropped")

    def _lowest_place(self, place: ToolPose) -> ToolPose:
        """A little below a place, with the hand clear of the table."""
        x, y, z = place.point
        floor = self._floor(_tool_rotation(place) @ DOWN, self.fingers.width)
        return ToolPose((x, y, min(z, max(z - _DEEPER, floor))), place.yaw, place.tilt)

    def _rise_off_table(self, pick: Pose, aimed: _Aim | None) -> float:
        """Height (m) by which a grasp must rise for the hand, open as it comes there, to be clear of the table."""
        width = self.hand.stroke if aimed is None else self._opening(*aimed[1:])
        return max(0.0, self._floor(finger_grasps.hand_axes(pick), width) - pick[0][2])

    def _floor(self, axes: FloatArray, width: float) -> float:
        """Lowest height (m) of the tip with axes (3, 3) of the hand and a width (m) between the pads."""
        return _LOWEST - float(self.hand.lowest_points(axes, width))

    def _opening(self, low: float, high: float) -> float:
        """Width between the pads on the way to what ends there along the closing axis, metres."""
        return min(self.hand.stroke, high - low + 2 * _SIDE)

    def _release(self) -> None:
        """Open, wait for what was held to rest, and draw back along the hand, then up."""
        fingers = self.fingers
        fingers.release()
        self._open(min(self.hand.stroke, fingers.width + 2 * finger_grasps.RELEASE))
        self.physics.wait_until_asleep(*_SETTLING)
        self._draw_back(self._current_axes())

    def _open(self, width: float) -> None:
        """Open to a width under the dynamics, gently: a finger within a hollow object may meet its other wall."""
        fingers, physics, force = self.fingers, self.physics, self.hand.gripping_force(0.0)
        fingers.release()
        start, step = fingers.width, 2 * self.hand.speed * physics.timestep * _PART
        for count in range(1, math.ceil(max(0.0, width - start) / step) + 1):
            fingers.command(min(width, start + count * step), force)
            physics.step(_PART)

    def _draw_back(self, axes: FloatArray) -> None:
        """Retreat along the hand."""
        here = self._current_tool_pose()
        self._follow_tool_poses((here, here.shifted_by(-finger_grasps.RETREAT * axes[:, 2])), FREE_SPEED)
        self.physics.simulate_until_at_rest()

    def _current_axes(self) -> FloatArray:
        return np.array(self.physics.data.site_xmat[self.physics.world.tip_site]).reshape(3, 3)

    def _describe_loss(self, number: int) -> str:
        name, slip = self.names[number], self.fingers.slip
        weight = self.physics.object_mass(number)
        touched = sorted(self.physics.objects_touching_object(number))
        hit = f" as it hit {' and '.join(self.names[other] for other in touched)}" if touched else ""
        force = self.fingers.force if slip is None else slip.force
        return f"{name} ({weight:.2g} kg) slipped from between the fingers, which press with {force:.3g} N{hit}"


_PART: Final = 4
"""Time steps between two commands of the fingers."""


def _wrap(angle: float) -> float:
    return float((angle + np.pi) % (2 * np.pi) - np.pi)


def _raised(pose: Pose, rise: float) -> Pose:
    (x, y, z), rotation = pose
    return (x, y, z + rise), rotation


def _tool_rotation(pose: ToolPose) -> FloatArray:
    """Rotation (3, 3) of the tool from straight down."""
    cos, sin = math.cos(pose.yaw), math.sin(pose.yaw)
    turn = np.array([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]])
    return rotations_from_rotvecs(np.array([pose.tilt]))[0] @ turn


def _drawn_back(pose: ToolPose) -> ToolPose:
    """The pose at the start of a straight approach along the hand."""
    return pose.shifted_by(-finger_grasps.RETREAT * (_tool_rotation(pose) @ DOWN)[:, 2])
