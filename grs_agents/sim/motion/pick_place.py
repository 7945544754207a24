"""The pick-and-place primitive: suction gated on contact and seal, placing until contact, typed failure."""

from dataclasses import dataclass
from typing import Final

import numpy as np

from grs_agents.base import Pose, Vec3
from grs_agents.base.geometry import transforms
from grs_agents.base.geometry.transforms import FloatArray
from grs_agents.sim.hands.suction_cup import CUP_RADIUS
from grs_agents.sim.instance.episode import Outcome
from grs_agents.sim.motion import grasp
from grs_agents.sim.motion.arm_motion import CLEARANCE, FREE_SPEED, HELD_SPEED, UP, ArmMotion, Descent
from grs_agents.sim.motion.placement import format_point
from grs_agents.sim.motion.tool_paths import (
    Payload,
    ToolPose,
    interpolate_upright,
    smoothstep,
    split_into_yaw_and_tilt,
    tool_up_axis,
)

ROPE_SPEED: Final = 0.2
_ROPE_CLEARANCE: Final = 0.01
"""Tied objects are dragged, slowly and low, rather than carried, so that they do not swing."""
_LOWEST: Final = 0.001
_PRESSED: Final = 0.0005
"""Lowest height of the tip, and its least depth below the pick point, metres: the 1 mm floor of a fixture, settled into
the table, lies lower than ``_LOWEST``."""
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


class PickPlaceMotion(ArmMotion):
    """Picks with the suction cup, tool down, and places, with the tool tilted if the poses ask for it."""

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
        self._follow_tool_poses((here, here.shifted_by(height * UP)), HELD_SPEED)
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

        descent = Descent(lowest, touches)
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
        descent = Descent(lowest, lambda: physics.is_object_supported(grasped))
        limp = physics.world.limp
        tied = grasped in limp
        fellows = limp if tied else {grasped}
        others = [obstacle for obstacle in self.obstacles if obstacle.owner not in fellows]
        hanging = float(np.hypot(radius, drop)) if tilted else drop
        aside = (hanging if tilted else radius) + 0.01
        speed, clearance = (ROPE_SPEED, _ROPE_CLEARANCE) if tied else (HELD_SPEED, CLEARANCE)
        if not self._travel_over_obstacles(near, aside, hanging, others, speed, clearance, descent):
            if physics.held_object_id is None:
                note = self._describe_drop(grasped)
                self._retreat_upwards()
                return PickPlaceResult(grasped, False, note, "dropped")
            here, held = self._current_tool_pose(), physics.held_object_id
            lower = here.shifted_by(np.array([0.0, 0.0, -0.02]))
            self._descend_until(here, lower, lambda: physics.is_object_supported(held))
            self._release_and_retreat(UP)
            how = f"over its neighbours to {format_point(place.point)}" + (" so tilted" if tilted else "")
            note = f"the arm cannot carry {self.names[grasped]} {how}{self._hindrance}"
            return PickPlaceResult(grasped, False, note, "unreachable")
        physics.step(_BEARING)
        kept = physics.held_object_id == grasped
        self._release_and_retreat(up)
        if kept:
            return PickPlaceResult(grasped, True, "placed")
        return PickPlaceResult(grasped, False, self._describe_drop(grasped), "dropped")

    def _payload(self, held: int) -> Payload | None:
        """Load as the cup feels it, the tool down."""
        physics = self.physics
        x, y, z = np.subtract(physics.center_of_mass(held), physics.tip_position).tolist()
        nozzle = physics.world.nozzle_for_object(held)
        return Payload(physics.object_mass(held), float(np.hypot(x, y)), max(0.0, -z), nozzle)

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
