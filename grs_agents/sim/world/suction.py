"""The suction cup: an object keeps its place on it until it pulls harder than the vacuum holds."""

from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from grs_agents.base.mujoco_import import mujoco
from grs_agents.sim.arms.arm_parts import CUP, ROBOT_CONTYPE, Nozzle
from grs_agents.sim.world.compilation import World

HOLDING_FORCE: Final = CUP.holding_force
"""Force that the suction cup holds, newtons."""
GRAVITY: Final = 9.81
"""Gravitational acceleration, m/s^2."""
PEELING_MOMENT: Final = CUP.peeling_moment
"""Moment that peels the cup's lip off, newton metres."""
WATCHED: Final = 4
"""Time steps between two checks of the cup's load; two checks over the limit in succession break the hold."""

_UPRIGHT: Final = 0.7
"""Least vertical part of the normal of a contact that supports an object."""


@dataclass(frozen=True)
class SuctionLoss:
    """An object torn off the cup: its id, and the load (N) and the moment (N m) on the cup at that time."""

    number: int
    load: float
    moment: float


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


class Cup:
    """The suction of a running world."""

    def __init__(self, world: World, data: Any) -> None:
        self._world, self._data = world, data
        self.held: int | None = None  # id of the object on the cup
        self.slip: SuctionLoss | None = None  # loss of the object held last
        self.due = WATCHED  # time steps until the next check of the load
        self._strained = False
        self._dof, self._weight = world.arm.dof, 0.0
        self._jacobian = np.zeros((3, world.model.nv))
        # Views of the state: creating them at each check would cost as much as the check.
        self._tip: Any = data.site_xpos[world.tip_site]
        self._tip_axes: Any = data.site_xmat[world.tip_site]
        self._joint_forces: Any = data.qfrc_applied[: self._dof]
        self._set_cup_collisions(True)
        self.fit_nozzle(CUP)

    def fit_nozzle(self, nozzle: Nozzle) -> None:
        """Pick with another nozzle from now on; a spatula keeps its shape."""
        self.nozzle = nozzle
        if self._world.model.geom_type[self._world.cup_geom] == mujoco.mjtGeom.mjGEOM_CYLINDER:
            self._world.model.geom_size[self._world.cup_geom, 0] = nozzle.radius

    def grasp(self, number: int) -> None:
        """Switch suction on: the object keeps its present pose relative to the cup; a rope's bead may rotate."""
        world, data = self._world, self._data
        weld, cup, body = world.welds[number], world.cup_body, world.bodies[number]
        self.nozzle = world.nozzle_for_object(number)
        back, relative, rotation = np.empty(4), np.empty(3), np.empty(4)
        mujoco.mju_negQuat(back, data.xquat[cup])
        mujoco.mju_rotVecQuat(relative, data.xpos[body] - data.xpos[cup], back)
        mujoco.mju_mulQuat(rotation, back, data.xquat[body])
        row = world.model.eq_data[weld]
        row[0:3], row[3:6], row[6:10] = 0.0, relative, rotation
        row[10] = float(number not in world.limp)  # how stiffly it holds the rotation
        data.eq_active[weld] = 1
        self.held, self.slip, self.due, self._strained = number, None, WATCHED, False
        self._weight = float(world.model.body_mass[body]) * GRAVITY
        self._compensate_held_weight(number)
        self._set_cup_collisions(False)

    def release(self, collides: bool = True) -> None:
        """Switch suction off.

        With ``collides`` False the cup collides again only after ``restore_collisions``: the released object comes to
        rest sooner without the cup on it.
        """
        if self.held is not None:
            self._data.eq_active[self._world.welds[self.held]] = 0
            self._set_cup_collisions(collides)
        self._joint_forces[:] = 0.0
        self.held = None

    def restore_collisions(self) -> None:
        """Let an empty cup collide again, after it was drawn back from the released object."""
        if self.held is None:
            self._set_cup_collisions(True)

    def _compensate_held_weight(self, number: int) -> None:
        """Add joint torques for the weight of the held object (payload compensation), so that the tip does not sag."""
        world, data = self._world, self._data
        if number not in world.limp:
            mujoco.mj_jacSite(world.model, data, self._jacobian, None, world.tip_site)
            np.multiply(self._jacobian[2, : self._dof], self._weight, out=self._joint_forces)

    def watch_anew(self) -> None:
        """Restart the load checks after the arm was set to another pose."""
        self.due, self._strained = WATCHED, False
        if self.held is not None:
            self._compensate_held_weight(self.held)

    def _set_cup_collisions(self, on: bool) -> None:
        """Let the cup collide with objects, or not: while it holds an object, the weld alone acts between them."""
        self._world.model.geom_contype[self._world.cup_geom] = ROBOT_CONTYPE if on else 0

    def release_if_overloaded(self, steps: int) -> None:
        """Count time steps, and release an object whose load or moment was too large at two checks in succession.

        A supported object may bend the cup: the lip yields a little and nothing tips.
        """
        self.due -= steps
        if self.due > 0:
            return
        self.due = WATCHED
        if self.held is None:
            return
        self._compensate_held_weight(self.held)
        (load, moment), before = self.measure_load(self.held), self._strained
        bent = moment > self.nozzle.peeling_moment and not is_supported(self._world, self._data, self.held)
        self._strained = load > self.nozzle.holding_force or bent
        if self._strained and before:
            number = self.held
            self.release()
            self.slip = SuctionLoss(number, load, moment)

    def measure_load(self, number: int) -> tuple[float, float]:
        """Load of the held object on the cup: force (N) and moment (N m).

        The force is tension and shear, without pressure; the moment is about the tip, across the cup's axis, 0 for an
        object that hangs freely.
        """
        world, data = self._world, self._data
        # Equalities come first among the constraints, and of all the welds to the cup one alone is active.
        x, y, z, p, q, r = data.efc_force[:6].tolist()
        _, _, a, _, _, b, _, _, c = self._tip_axes.tolist()
        pressing = max(0.0, -(x * a + y * b + z * c))
        load = max(0.0, x * x + y * y + z * z - pressing * pressing) ** 0.5
        if number in world.limp:
            return load, 0.0
        body = world.bodies[number]
        # The weld acts at the object's origin; its rows for the rotation are half the torque, in the object's frame.
        i, j, k = (data.xpos[body] - self._tip).tolist()
        xx, xy, xz, yx, yy, yz, zx, zy, zz = data.xmat[body].tolist()
        u = (xx * p + xy * q + xz * r) / 2 + j * z - k * y
        v = (yx * p + yy * q + yz * r) / 2 + k * x - i * z
        w = (zx * p + zy * q + zz * r) / 2 + i * y - j * x
        twist = u * a + v * b + w * c
        return load, max(0.0, u * u + v * v + w * w - twist * twist) ** 0.5
