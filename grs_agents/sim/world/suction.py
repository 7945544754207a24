"""The suction cup: an object keeps its place on it until it pulls harder than the vacuum holds."""

from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from grs_agents.mujoco_import import mujoco
from grs_agents.sim.arms import ROBOT_CONTYPE
from grs_agents.sim.world.compilation import World

HOLDING_FORCE: Final = 15.0
"""What the suction cup holds, newtons: 60 kPa below the air's pressure on a disk of 20 mm (18.8 N), times 0.8."""
WATCHED: Final = 4
"""Time steps between two looks at the load of the cup; two looks in succession over the limit break the hold."""


@dataclass(frozen=True)
class Slip:
    """An object that was torn off the cup: its id, and the load on the cup then, newtons."""

    number: int
    load: float


class Cup:
    """The suction of one running world."""

    def __init__(self, world: World, data: Any) -> None:
        self._world, self._data = world, data
        self.held: int | None = None  # id of the object on the cup
        self.slip: Slip | None = None  # how the last object that was held was torn off
        self.due = WATCHED  # time steps until the load is to be looked at
        self._strained = False
        self._set_cup_collisions(True)

    def grasp(self, number: int) -> None:
        """Switch suction on: the object keeps its present pose relative to the cup; a rope's bead is free to turn."""
        world, data = self._world, self._data
        weld, cup, body = world.welds[number], world.cup_body, world.bodies[number]
        back, relative, rotation = np.empty(4), np.empty(3), np.empty(4)
        mujoco.mju_negQuat(back, data.xquat[cup])
        mujoco.mju_rotVecQuat(relative, data.xpos[body] - data.xpos[cup], back)
        mujoco.mju_mulQuat(rotation, back, data.xquat[body])
        row = world.model.eq_data[weld]
        row[0:3], row[3:6], row[6:10] = 0.0, relative, rotation
        row[10] = float(number not in world.limp)  # how stiffly it holds the rotation
        data.eq_active[weld] = 1
        self.held, self.slip, self.due, self._strained = number, None, WATCHED, False
        self._set_cup_collisions(False)

    def release(self) -> None:
        """Switch suction off."""
        if self.held is not None:
            self._data.eq_active[self._world.welds[self.held]] = 0
            self._set_cup_collisions(True)
        self.held = None

    def _set_cup_collisions(self, on: bool) -> None:
        """Whether the cup meets objects: while it holds one, the weld alone acts between them, and none fights it."""
        self._world.model.geom_contype[self._world.cup_geom] = ROBOT_CONTYPE if on else 0

    def release_if_overloaded(self, steps: int) -> None:
        """Count time steps, and let go of an object that has pulled too hard at two looks in succession."""
        self.due -= steps
        if self.due > 0:
            return
        self.due = WATCHED
        if self.held is None:
            return
        load, before = self.measure_load_force(), self._strained
        self._strained = load > HOLDING_FORCE
        if self._strained and before:
            number = self.held
            self.release()
            self.slip = Slip(number, load)

    def measure_load_force(self) -> float:
        """How hard what is held pulls at the cup and shears along it, newtons; pressing on it is no load."""
        if self.held is None:
            return 0.0
        # Equalities come first among the constraints, and of all the welds to the cup one alone is active.
        x, y, z = self._data.efc_force[:3].tolist()
        _, _, a, _, _, b, _, _, c = self._data.site_xmat[self._world.tip_site].tolist()
        pressing = max(0.0, -(x * a + y * b + z * c))
        return float(max(0.0, x * x + y * y + z * z - pressing * pressing) ** 0.5)
