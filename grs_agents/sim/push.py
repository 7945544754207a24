"""The pushing primitive: a spatula comes down behind a pose, moves straight along the table, and lifts."""

from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt

from grs_agents.base import Pose, Vec3
from grs_agents.sim import kinematics
from grs_agents.sim.primitives import FREE_SPEED, Motion, PickPlace, move
from grs_agents.sim.reach import at, wrap
from grs_agents.sim.spatula import BLADE_THICKNESS, BLADE_WIDTH

FloatArray = npt.NDArray[np.float64]
HEIGHT: Final = 0.005
BEFORE: Final = 0.02
SHORT: Final = 0.05
"""The tip moves at ``HEIGHT`` from ``BEFORE`` ahead of ``pose0`` to ``SHORT`` of ``pose1``, metres, as published."""
_SPEED: Final = 0.30
_RAMP: Final = 0.12
"""Seconds in which a stroke reaches its speed, and stops: gentler than friction, so that nothing slides on."""
_DOWN_SPEED: Final = 0.1
_ABOVE: Final = 0.06
_MOVED: Final = 0.005


@dataclass(frozen=True)
class PushResult:
    """What a push did.

    Attributes:
        pushed: ids of what it moved, farthest first.
        note: one clause; ``"pushed"`` when all went well.
    """

    pushed: tuple[int, ...]
    note: str


def stroke(pose0: Pose, pose1: Pose) -> tuple[FloatArray, FloatArray] | None:
    """Where the tip starts and ends (3,), metres; None if the poses are too near one another for any push."""
    start, end = np.array([*pose0[0][:2], HEIGHT]), np.array([*pose1[0][:2], HEIGHT])
    length = float(np.linalg.norm(end - start))
    if length + BEFORE - SHORT < 0.001:
        return None
    along = (end - start) / length
    return start - BEFORE * along, end - SHORT * along


def poses_of(start: FloatArray, end: FloatArray) -> tuple[Vec3, Vec3]:
    """The positions of ``pose0`` and ``pose1`` for which the tip moves from ``start`` to ``end`` (2,), metres."""
    along = (end - start) / np.linalg.norm(end - start)
    first, last = start + BEFORE * along, end + SHORT * along
    return (float(first[0]), float(first[1]), HEIGHT), (float(last[0]), float(last[1]), HEIGHT)


class Push(PickPlace):
    """Pushes with the spatula; gets from place to place as `PickPlace` does."""

    def push(self, pose0: Pose, pose1: Pose) -> PushResult:
        """Do it: down behind ``pose0``, straight towards ``pose1``, up."""
        way = stroke(pose0, pose1)
        if way is None:
            return PushResult((), f"pose0 and pose1 are less than {SHORT - BEFORE:.2f} m apart, that pushes nothing")
        physics = self.physics
        before = {number: physics.pose(number)[0] for number in physics.world.addresses}
        note = self._along(*way)
        moved = {
            number: float(np.linalg.norm(np.subtract(physics.pose(number)[0], start)))
            for number, start in before.items()
        }
        pushed = sorted((number for number in moved if moved[number] > _MOVED), key=lambda number: -moved[number])
        return PushResult(tuple(pushed), note)

    def _along(self, start: FloatArray, end: FloatArray) -> str:
        physics = self.physics
        yaw = self.yaw + self._turn(float(np.arctan2(end[1] - start[1], end[0] - start[0])))
        low, last = _vec(start), _vec(end)
        above = (low[0], low[1], low[2] + _ABOVE)
        motion = straight(physics.timestep, start, end, yaw)
        if not motion.possible or not kinematics.reachable(np.array([low, last])).all():
            return f"the arm cannot reach from {at(low)} to {at(last)} with the tool down"
        if not self._travel(above, yaw, BLADE_WIDTH / 2 + BLADE_THICKNESS, 0.0, self.obstacles, FREE_SPEED):
            return f"the arm cannot reach {at(low)} with the tool down"
        self._follow(move(physics.timestep, physics.tip, low, (yaw, yaw), _DOWN_SPEED), lambda: bool(physics.touched()))
        under = sorted(physics.touched())
        if under and physics.tip[2] > HEIGHT + 0.004:
            self._lift(yaw)
            return f"the blade came down on {self.names[under[0]]} at {at(low)}"
        self._follow(motion)
        physics.arrive(motion.joints[-1])
        self._lift(yaw)
        return "pushed"

    def _turn(self, direction: float) -> float:
        """The smallest turn of the tool that sets the blade across a direction, unwinding the wrist where needed."""
        turn = wrap(direction - self.yaw, np.pi)
        wound = float(self.physics.data.ctrl[5])
        if abs(wound) > np.pi and turn * wound < 0:
            turn += np.pi * float(np.sign(wound))
        return turn

    def _lift(self, yaw: float) -> None:
        tip = self.physics.tip
        self._go((tip, (tip[0], tip[1], tip[2] + _ABOVE)), yaw, 0.5)
        self.physics.settle()


def straight(timestep: float, start: FloatArray, end: FloatArray, yaw: float) -> Motion:
    """The tool's straight way from start to end (3,), metres, at one yaw (rad), one row a time step."""
    length = float(np.linalg.norm(end - start))
    ramp = min(_RAMP, length / _SPEED)
    seconds = length / _SPEED + ramp
    time = np.linspace(0.0, seconds, max(4, int(seconds / timestep) + 1))
    gone = np.minimum(time, ramp) ** 2 / (2 * ramp) + np.clip(time - ramp, 0.0, seconds - 2 * ramp)
    gone += ramp / 2 - (np.minimum(seconds - time, ramp)) ** 2 / (2 * ramp)
    points = start + (end - start) * (gone / gone[-1])[:, None]
    return Motion(kinematics.solve(points, np.full(len(points), yaw)))


def _vec(point: FloatArray) -> Vec3:
    return (float(point[0]), float(point[1]), float(point[2]))
