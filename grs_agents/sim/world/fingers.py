"""Two fingers of a running world: they hold by friction alone, and lose what slips from between their pads."""

from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from grs_agents.base.geometry.transforms import FloatArray
from grs_agents.base.mujoco_import import mujoco
from grs_agents.sim.hands.hand import ROBOT_CONTYPE
from grs_agents.sim.hands.two_fingers import PAD_FRICTION
from grs_agents.sim.world.compilation import World
from grs_agents.sim.world.grip import WATCHED, Grip

_SHARE: Final = 0.5
"""Share of the friction available to weight and motion: a twofold safety factor, as for the cup."""

_TRIED_WIDTHS: Final = 6


@dataclass(frozen=True)
class FingerLoss:
    """An object that slipped from between the pads, and the gripping force, newtons."""

    number: int
    force: float


class Fingers(Grip):
    """The fingers of a running world; widths are between their pads, metres."""

    def __init__(self, world: World, data: Any) -> None:
        super().__init__(world, data)
        assert world.fingers is not None, "the hand has no fingers"
        self.hand, self._index = world.fingers.hand, world.fingers
        self.slip: FingerLoss | None = None  # loss of the object held last
        self._robot: npt.NDArray[np.bool_] = world.model.geom_contype == ROBOT_CONTYPE
        self.force, self.closing = self.hand.forces[1], False
        self.set_width(self.hand.stroke)

    @property
    def width(self) -> float:
        """Width between the pads."""
        return sum(self._data.qpos[self._index.positions].tolist())  # numpy's sum takes longer for two

    @property
    def commanded_width(self) -> float:
        """Width commanded now."""
        return sum(self._data.ctrl[self._index.actuators].tolist())

    def set_width(self, width: float) -> None:
        """Set the fingers to a width, at rest, without dynamics."""
        self._data.qpos[self._index.positions] = width / 2
        self._data.qvel[self._index.velocities] = 0.0
        self.command(width, self.force)

    def narrow_to(self, width: float) -> float:
        """Set the fingers to a width, or as near to it as they come without contact; returns the width."""
        widest = self.width
        for share in np.linspace(0.0, 1.0, _TRIED_WIDTHS):
            self.set_width(width + share * (widest - width))
            mujoco.mj_kinematics(self._world.model, self._data)
            mujoco.mj_collision(self._world.model, self._data)
            if not self._robot[self._data.contact.geom].any():
                break
        return self.width

    @property
    def openness(self) -> float:
        """Command as the last entry of an action: 1 to close and hold, else minus the share of the stroke, -1..0."""
        return 1.0 if self.closing else -self.commanded_width / self.hand.stroke

    def command(self, width: float, force: float, closing: bool = False) -> None:
        """Command a width and the greatest force of a finger, newtons; ``closing`` on what is between the pads."""
        self.force, self.closing = force, closing
        self._world.model.actuator_forcerange[self._index.actuators] = (-force, force)
        self._data.ctrl[self._index.actuators] = width / 2

    def pads_touching(self, number: int) -> int:
        """Number of pads that touch an object."""
        pairs = self._data.contact.geom
        touching = (self._world.owner_of_geom[pairs] == number).any(axis=1)
        return sum(bool((touching & (pairs == pad).any(axis=1)).any()) for pad in self._index.pads)

    def touched_objects(self) -> set[int]:
        """Ids of the objects between the pads: both touch them."""
        if self._data.ncon == 0:
            return set()
        owners = self._world.owner_of_geom[self._data.contact.geom]
        return {number for number in set(owners.ravel().tolist()) - {-1} if self.pads_touching(number) == 2}

    def move_towards(self, openness: float, steps: int) -> None:
        """Move the commanded width, for a number of time steps at the speed of the hand, as ``openness`` says.

        What both pads touch is noted as held, and gripped as suits its mass; opening lets go of it.
        """
        farthest = 2 * self.hand.speed * float(self._world.model.opt.timestep) * steps
        now = self.commanded_width
        if openness <= 0:
            if self.closing:  # the command went on closing where the object stopped the pads
                now = self.width
            self.release()
            goal = -openness * self.hand.stroke
            self.command(now + min(max(goal - now, -farthest), farthest), self.hand.forces[1])
            return
        between = self.touched_objects() if self.held is None else {self.held}
        mass = 0.0
        if between:
            number = min(between)
            mass = float(self._world.model.body_mass[self._world.bodies[number]])
            if self.held is None and self._world.addresses.get(number) is not None:
                self.grasp(number)
        self.command(max(0.0, now - farthest), self.hand.gripping_force(mass), closing=True)

    def grasp(self, number: int) -> None:
        """Note an object between the closed pads as held."""
        self.slip = None
        self._take(number)

    def release(self) -> None:
        """Note the hand as empty; ``command`` opens it."""
        self.held = None
        self._joint_forces[:] = 0.0

    def meets_anything_else(self) -> bool:
        """As ``Grip.meets_anything_else``."""
        if self._data.ncon == 0:
            return False
        if self.held is None:
            return True
        pairs = self._data.contact.geom
        held = (self._world.owner_of_geom[pairs] == self.held).any(axis=1)
        return not bool((held & self._robot[pairs].any(axis=1)).all())

    def would_lose(self, forces: FloatArray, levers: FloatArray, axes: FloatArray) -> bool:
        """As ``Grip.would_lose``: half the friction of both pads is for the load."""
        del levers, axes  # pads bear the moment of what hung still from them
        return float(np.linalg.norm(forces, axis=1).max()) > _SHARE * 2 * PAD_FRICTION[0] * self.force

    def release_if_overloaded(self, steps: int) -> None:
        """As ``Grip.release_if_overloaded``: both pads must touch what they hold."""
        self.due -= steps
        if self.due > 0:
            return
        self.due = WATCHED
        if self.held is None:
            return
        self._compensate_held_weight(self.held)
        before, self._strained = self._strained, self.pads_touching(self.held) < 2
        if self._strained and before:
            self.slip = FingerLoss(self.held, self.force)
            self.release()
