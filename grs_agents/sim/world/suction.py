"""The suction cup: an object keeps its place on it until it pulls harder than the vacuum holds."""

from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from grs_agents.base.geometry.transforms import FloatArray
from grs_agents.base.mujoco_import import mujoco
from grs_agents.sim.hands.hand import ROBOT_CONTYPE
from grs_agents.sim.hands.suction_cup import CUP, Nozzle
from grs_agents.sim.world.compilation import World
from grs_agents.sim.world.grip import WATCHED, Grip, is_supported

HOLDING_FORCE: Final = CUP.holding_force
"""Force that the suction cup holds, newtons."""
PEELING_MOMENT: Final = CUP.peeling_moment
"""Moment that peels the cup's lip off, newton metres."""


@dataclass(frozen=True)
class SuctionLoss:
    """An object torn off the cup: its id, and the load (N) and the moment (N m) on the cup at that time."""

    number: int
    load: float
    moment: float


class Cup(Grip):
    """The suction of a running world."""

    def __init__(self, world: World, data: Any) -> None:
        super().__init__(world, data)
        self.slip: SuctionLoss | None = None  # loss of the object held last
        # Views of the state: creating them at each check would cost as much as the check.
        self._tip: Any = data.site_xpos[world.tip_site]
        self._tip_axes: Any = data.site_xmat[world.tip_site]
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
        weld, cup, body = world.welds[number], world.hand_body, world.bodies[number]
        self.nozzle = world.nozzle_for_object(number)
        back, relative, rotation = np.empty(4), np.empty(3), np.empty(4)
        mujoco.mju_negQuat(back, data.xquat[cup])
        mujoco.mju_rotVecQuat(relative, data.xpos[body] - data.xpos[cup], back)
        mujoco.mju_mulQuat(rotation, back, data.xquat[body])
        row = world.model.eq_data[weld]
        row[0:3], row[3:6], row[6:10] = 0.0, relative, rotation
        row[10] = float(number not in world.limp)  # how stiffly it holds the rotation
        data.eq_active[weld] = 1
        self.slip = None
        self._take(number)
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

    def meets_anything_else(self) -> bool:
        """As ``Grip.meets_anything_else``: the weld is no contact."""
        return bool(self._data.ncon)

    def would_lose(self, forces: FloatArray, levers: FloatArray, axes: FloatArray) -> bool:
        """As ``Grip.would_lose``: the load is tension and shear, the moment acts across the cup's axis."""
        (x, y, z), (i, j, k), (a, b, c) = forces.T, levers.T, axes.T
        pressing: FloatArray = np.minimum(x * a + y * b + z * c, 0.0)
        u, v, w = j * z - k * y, k * x - i * z, i * y - j * x
        twist = u * a + v * b + w * c
        loads: FloatArray = x * x + y * y + z * z - pressing**2
        moments: FloatArray = u * u + v * v + w * w - twist**2
        nozzle = self.nozzle
        return bool(loads.max() > nozzle.holding_force**2 or moments.max() > nozzle.peeling_moment**2)

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
