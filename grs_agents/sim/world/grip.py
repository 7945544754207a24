"""The grip of a running world: which object the hand holds, and the load on the arm of its weight."""

from abc import ABC, abstractmethod
from typing import Any, Final

import numpy as np

from grs_agents.base.geometry.transforms import FloatArray
from grs_agents.base.mujoco_import import mujoco
from grs_agents.sim.hands.hand import GRAVITY, ROBOT_CONTYPE
from grs_agents.sim.world.compilation import World

WATCHED: Final = 4
"""Time steps between two checks of the grip; two failed checks in succession break the hold."""

_UPRIGHT: Final = 0.7
"""Least vertical part of the normal of a contact that supports an object."""


def is_supported(world: World, data: Any, number: int) -> bool:
    """Whether anything but the robot supports an object."""
    if data.ncon == 0:
        return False
    pairs = data.contact.geom
    touching = world.owner_of_geom[pairs] == number
    robot = (world.model.geom_contype[pairs] == ROBOT_CONTYPE).any(axis=1)
    upwards = data.contact.frame[:, 2]  # normal from the first geom of a pair to the second
    held_up = (touching[:, 0] & (upwards < -_UPRIGHT)) | (touching[:, 1] & (upwards > _UPRIGHT))
    return bool((held_up & ~robot).any())


class Grip(ABC):
    """The hold of a hand on an object.

    Attributes:
        held: id of the held object; None for an empty hand.
        due: time steps until the next check of the hold.
    """

    def __init__(self, world: World, data: Any) -> None:
        self._world, self._data = world, data
        self.held: int | None = None
        self.due = WATCHED
        self._strained = False
        self._dof, self._weight = world.arm.dof, 0.0
        self._jacobian = np.zeros((3, world.model.nv))
        self._joint_forces: Any = data.qfrc_applied[: self._dof]

    @abstractmethod
    def release(self) -> None:
        """Let go of the held object."""

    @abstractmethod
    def meets_anything_else(self) -> bool:
        """Whether there is any contact beyond those by which the hand holds its object."""

    @abstractmethod
    def would_lose(self, forces: FloatArray, levers: FloatArray, axes: FloatArray) -> bool:
        """Whether the held object would be lost under a load on the hand.

        Args:
            forces: (N, 3) on the hand, newtons.
            levers: (N, 3) from the tip to where they act, metres.
            axes: (N, 3) out of the back of the hand.
        """

    @abstractmethod
    def release_if_overloaded(self, steps: int) -> None:
        """Count time steps, and let go of an object that is lost at two checks in succession."""

    def watch_anew(self) -> None:
        """Restart the checks after the arm was set to another pose."""
        self.due, self._strained = WATCHED, False
        if self.held is not None:
            self._compensate_held_weight(self.held)

    def _take(self, number: int) -> None:
        """Note an object as held."""
        self.held, self.due, self._strained = number, WATCHED, False
        self._weight = float(self._world.model.body_mass[self._world.bodies[number]]) * GRAVITY
        self._compensate_held_weight(number)

    def _compensate_held_weight(self, number: int) -> None:
        """Add joint torques for the weight of the held object (payload compensation), so that the tip does not sag."""
        world, data = self._world, self._data
        if number not in world.limp:
            mujoco.mj_jacSite(world.model, data, self._jacobian, None, world.tip_site)
            np.multiply(self._jacobian[2, : self._dof], self._weight, out=self._joint_forces)
