"""The pick-and-place primitive: suction gated on contact, placing until contact, typed failure."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Final

import numpy as np
import numpy.typing as npt

from grs_agents.base import Pose, Vec3
from grs_agents.sim import kinematics, utils
from grs_agents.sim.geometry import Prism
from grs_agents.sim.physics import Physics
from grs_agents.sim.robot import CUP_RADIUS

FloatArray = npt.NDArray[np.float64]
FREE_SPEED: Final = 1.2
HELD_SPEED: Final = 0.8
TOUCH_SPEED: Final = 0.06
ROPE_SPEED: Final = 0.2
"""What is tied to other things is dragged rather than carried: slowly and low, else it flings about."""
_CLEARANCE: Final = 0.03
_ROPE_CLEARANCE: Final = 0.01
_LOWEST: Final = 0.001
_RETREAT: Final = 0.06
_DETOURS: Final = (0.35, 0.45, 0.28, 0.55, 0.70)


@dataclass(frozen=True)
class PickPlaceResult:
    """What a pick-and-place did.

    Attributes:
        grasped: id of the object that was picked, None if nothing was.
        placed: it was brought to the place pose and let go there.
        note: one clause; ``"placed"`` when all went well.
    """

    grasped: int | None
    placed: bool
    note: str


@dataclass(frozen=True)
class Motion:
    """A stretch of the tip's way: joint angles (N, 6), one a time step."""

    joints: FloatArray

    @property
    def possible(self) -> bool:
        """Whether the arm can follow it all."""
        return bool(np.isfinite(self.joints).all())


def sweep(start: Vec3, end: Vec3, samples: int) -> FloatArray:
    """Points (samples, 3) from start to end that keep their distance from the base axis in between."""
    radius = np.hypot([start[0], end[0]], [start[1], end[1]])
    angle = np.arctan2([start[1], end[1]], [start[0], end[0]])
    share = np.linspace(0.0, 1.0, samples)
    share = share * share * (3 - 2 * share)
    r = radius[0] + share * (radius[1] - radius[0])
    a = angle[0] + share * (angle[1] - angle[0])
    return np.stack([r * np.cos(a), r * np.sin(a), start[2] + share * (end[2] - start[2])], axis=1)


def move(timestep: float, start: Vec3, end: Vec3, yaws: tuple[float, float], speed: float) -> Motion:
    """The motion from start to end, the tool turning between two yaws (radians), smooth at both ends."""
    turning = abs(yaws[1] - yaws[0])
    length = float(np.linalg.norm(np.subtract(end, start))) + 0.25 * turning
    samples = max(4, int(1.5 * length / speed / timestep))
    points = sweep(start, end, samples)
    share = np.linspace(0.0, 1.0, samples)
    share = share * share * (3 - 2 * share)
    return Motion(kinematics.solve(points, yaws[0] + share * (yaws[1] - yaws[0])))


def highest_along(start: Vec3, end: Vec3, radius: float, obstacles: Sequence[Prism]) -> float:
    """The top of the highest obstacle that comes within ``radius`` of the way from start to end."""
    if not obstacles:
        return 0.0
    points = sweep(start, end, 24)[:, :2]
    boxes = np.array([obstacle.box for obstacle in obstacles])
    outside = np.maximum(boxes[:, None, :2] - points[None], points[None] - boxes[:, None, 2:])
    near = np.linalg.norm(np.maximum(outside, 0.0), axis=2).min(axis=1) < radius
    heights = np.array([obstacle.high for obstacle in obstacles])
    return float(heights[near].max()) if near.any() else 0.0


def routes(start: Vec3, end: Vec3) -> list[list[Vec3]]:
    """Ways over the table: straight first, then drawn in (or out) to a circle around the base and along it."""
    found: list[list[Vec3]] = [[start, end]]
    for radius in _DETOURS:
        corners = [
            (radius * float(np.cos(angle)), radius * float(np.sin(angle)), start[2])
            for angle in (np.arctan2(start[1], start[0]), np.arctan2(end[1], end[0]))
        ]
        found.append([start, *corners, end])
    return found


class PickPlace:
    """Picks with the suction cup at one pose and places at another, tool pointing down.

    Args:
        physics: the running world.
        obstacles: outlines of every object.
        names: object id to asset name, for the notes.
    """

    def __init__(self, physics: Physics, obstacles: Sequence[Prism], names: dict[int, str]) -> None:
        self.physics, self.obstacles, self.names = physics, obstacles, names
        self.yaw = physics.tip_yaw()

    def run(self, pick: Pose, place: Pose) -> PickPlaceResult:
        """Do it. ``pick`` is where the cup touches; ``place`` is where the cup is to be, lowered until contact."""
        grasped, note = self._pick(utils.vec3(pick[0]))
        if grasped is None:
            return PickPlaceResult(None, False, note)
        yaw = self.yaw + _nearest_turn(utils.yaw_of(place[1]) - utils.yaw_of(pick[1]))
        note = self._place(grasped, utils.vec3(place[0]), yaw)
        return PickPlaceResult(grasped, note == "placed", note)

    def _pick(self, point: Vec3) -> tuple[int | None, str]:
        physics = self.physics
        wound = float(physics.data.ctrl[5])
        unwind = 2 * np.pi * float(np.sign(wound)) if abs(wound) > 1.2 * np.pi else 0.0
        near = (point[0], point[1], point[2] + 0.008)
        if not self._travel(near, self.yaw + unwind, CUP_RADIUS + 0.04, 0.0, self.obstacles, FREE_SPEED):
            return None, f"the arm cannot reach {_at(point)} with the tool down"
        lowest = (point[0], point[1], max(_LOWEST, point[2] - 0.03))
        descent = move(physics.timestep, near, lowest, (self.yaw, self.yaw), TOUCH_SPEED)
        if not descent.possible:
            return None, f"the arm cannot reach {_at(lowest)} with the tool down"
        self._follow(descent, lambda: bool(physics.touched()))
        touched = sorted(physics.touched() & physics.world.welds.keys())
        if not touched:
            fixed = sorted(physics.touched())
            what = f"{self.names[fixed[0]]}, which is fixed," if fixed else "nothing to grasp"
            return None, f"{what} at {_at(point)}"
        physics.grasp(touched[0])
        return touched[0], "grasped"

    def _place(self, grasped: int, point: Vec3, yaw: float) -> str:
        physics, tip = self.physics, self.physics.tip
        own = [obstacle for obstacle in self.obstacles if obstacle.owner == grasped]
        tied = grasped in physics.world.jointed
        fellows = physics.world.jointed if tied else {grasped}
        others = [obstacle for obstacle in self.obstacles if obstacle.owner not in fellows]
        drop = max(0.0, tip[2] - min((prism.low for prism in own), default=tip[2]))
        radius = max(
            (float(np.linalg.norm(prism.outline - np.asarray(tip[:2]), axis=1).max()) for prism in own), default=0.05
        )
        near = (point[0], point[1], point[2] + 0.012)
        speed, clearance = (ROPE_SPEED, _ROPE_CLEARANCE) if tied else (HELD_SPEED, _CLEARANCE)
        if not self._travel(near, yaw, radius + 0.01, drop, others, speed, clearance):
            self._put_down()
            return f"the arm cannot carry {self.names[grasped]} over its neighbours to {_at(point)}"
        lowest = (point[0], point[1], max(drop - 0.01, point[2] - 0.25, _LOWEST))
        descent = move(physics.timestep, near, lowest, (yaw, yaw), TOUCH_SPEED)
        if descent.possible:
            self._follow(descent, lambda: physics.supported(grasped))
        physics.step(10)
        held = physics.held == grasped
        self._release()
        return "placed" if held else f"{self.names[grasped]} was dropped on the way"

    def _put_down(self) -> None:
        tip = self.physics.tip
        descent = move(self.physics.timestep, tip, (tip[0], tip[1], tip[2] - 0.02), (self.yaw, self.yaw), TOUCH_SPEED)
        if descent.possible:
            held = self.physics.held
            self._follow(descent, lambda: held is not None and self.physics.supported(held))
        self._release()

    def _release(self) -> None:
        physics = self.physics
        physics.release()
        physics.step(25)
        tip = physics.tip
        self._go((tip, (tip[0], tip[1], tip[2] + 0.02)), self.yaw, 0.2)
        self._go((physics.tip, (tip[0], tip[1], tip[2] + _RETREAT)), self.yaw, FREE_SPEED)
        physics.settle()

    def _travel(
        self,
        end: Vec3,
        yaw: float,
        radius: float,
        drop: float,
        obstacles: Sequence[Prism],
        speed: float,
        clearance: float = _CLEARANCE,
    ) -> bool:
        """Go over the table to a point and down to it, each leg just above what lies within ``radius`` of it.

        Args:
            end: where the tip is to be, metres.
            yaw: of the tool at the end, radians.
            radius: of what must pass, about the tip, metres.
            drop: how far what hangs from the cup reaches below it, metres.
            obstacles: what to pass over.
            speed: of the tip, m/s.
            clearance: to what it passes over, metres.

        Returns:
            Whether there was a way; if not, the arm has not moved.
        """
        tip = self.physics.tip
        for route in routes(tip, end):
            way: list[Vec3] = [tip]
            for start, stop in pairwise(route):
                height = highest_along(start, stop, radius, obstacles) + drop + clearance
                height = max(height, end[2] if stop == end else 0.0, tip[2] + 0.02 if drop else 0.0)
                way += [(start[0], start[1], height), (stop[0], stop[1], height)]
            if self._go((*way, end), yaw, speed):
                return True
        return False

    def _go(self, points: Sequence[Vec3], yaw: float, speed: float) -> bool:
        """Follow straight stretches; False, without moving, if any point is out of the arm's reach."""
        longest = max(
            range(1, len(points)), key=lambda i: float(np.linalg.norm(np.subtract(points[i][:2], points[i - 1][:2])))
        )
        motions: list[Motion] = []
        turned = self.yaw
        for index in range(1, len(points)):
            target = yaw if index >= longest else turned
            motions.append(move(self.physics.timestep, points[index - 1], points[index], (turned, target), speed))
            turned = target
        if not all(motion.possible for motion in motions):
            return False
        for motion in motions:
            self._follow(motion)
        self.physics.arrive(motions[-1].joints[-1])
        self.yaw = yaw
        return True

    def _follow(self, motion: Motion, stop: Callable[[], bool] | None = None) -> None:
        """Follow a motion, its last joint continued from how far the wrist is wound now."""
        joints = motion.joints
        wound = float(self.physics.data.ctrl[5])
        joints[:, 5] += 2 * np.pi * np.round((wound - joints[0, 5]) / (2 * np.pi))
        self.physics.follow(joints, stop)


def _nearest_turn(angle: float) -> float:
    return float((angle + np.pi) % (2 * np.pi) - np.pi)


def _at(point: Vec3) -> str:
    return f"({point[0]:.2f}, {point[1]:.2f}, {point[2]:.2f})"
