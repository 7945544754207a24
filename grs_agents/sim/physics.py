"""Stepping a world: a budget of simulated steps, settling, contacts, suction, and arm paths."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from grs_agents.base import Pose, Quat, Vec3
from grs_agents.sim import utils
from grs_agents.sim.engine import mujoco
from grs_agents.sim.episode import SimulationBudgetError
from grs_agents.sim.kinematics import DOWN
from grs_agents.sim.world import World

FloatArray = npt.NDArray[np.float64]
DEFAULT_BUDGET: Final = 500_000
_STILL: Final = 0.01
_ARRIVED: Final = 0.002
"""Radians from the end of a motion at which the next one begins: 1 mm of the tip."""
_GENTLE: Final = 0.15
"""Fastest a body may be pushed out of another while the scene settles at reset, m/s."""
HOLDING_FORCE: Final = 15.0
"""What the suction cup holds, newtons: 60 kPa below the air's pressure on a disk of 20 mm (18.8 N), times 0.8."""
_WATCHED: Final = 4
"""Time steps between two looks at the load of the cup; two looks in succession over the limit break the hold."""

_SOLID: Final = np.array([1, 0, 0, 1, 0, 0], dtype=np.uint8)
"""Geom groups that a ray meets: objects' colliders and the table, not the arm."""


@dataclass(frozen=True)
class Slip:
    """An object that was torn off the cup: its id, and the load on the cup then, newtons."""

    number: int
    load: float


class Budget:
    """Simulated steps left to one environment."""

    def __init__(self, steps: int = DEFAULT_BUDGET) -> None:
        self.limit = self.left = steps

    def spend(self, steps: int) -> None:
        """Take ``steps``.

        Raises:
            SimulationBudgetError: there are not so many left.
        """
        self.left -= steps
        if self.left < 0:
            raise SimulationBudgetError(
                f"the environment used up its {self.limit} simulated steps", "reset less often or do less in a step"
            )


class Physics:
    """One running world.

    Args:
        world: the compiled model.
        budget: shared by the worlds of one environment.
        joints: joint positions (dof,) to start from, None for home.
    """

    def __init__(self, world: World, budget: Budget, joints: FloatArray | None = None) -> None:
        self.world, self.budget = world, budget
        self.model: Any = world.model
        self.data: Any = mujoco.MjData(self.model)
        self.timestep = float(self.model.opt.timestep)
        self.arm, self.dof = world.arm, world.arm.dof
        if joints is None:
            joints = self.arm.home
        self.data.qpos[: self.dof] = joints
        self.data.ctrl[: self.dof] = joints
        gain = self.model.actuator_gainprm[: self.dof, 0]
        self._lead: FloatArray = -self.model.actuator_biasprm[: self.dof, 2] / gain
        self.held: int | None = None
        self.slip: Slip | None = None
        self._unwatched, self._strained = 0, False
        self.observer: Callable[[], None] | None = None
        mujoco.mj_forward(self.model, self.data)

    @property
    def joints(self) -> FloatArray:
        """Joint positions (dof,) of the arm: radians, or metres of a slide."""
        return np.array(self.data.qpos[: self.dof])

    @property
    def commanded(self) -> FloatArray:
        """The joint positions (dof,) that the arm is told to keep."""
        return np.array(self.data.ctrl[: self.dof])

    @property
    def tip(self) -> Vec3:
        """Where the suction cup is, metres."""
        return utils.vec3(self.data.site_xpos[self.world.tip_site])

    def tip_yaw(self) -> float:
        """The tool's turn about the vertical, radians."""
        matrix = self.data.site_xmat[self.world.tip_site]
        return float(np.arctan2(matrix[3], matrix[0]))

    def tip_rotation(self) -> Quat:
        """How the tool is turned from straight down, xyzw."""
        matrix = np.asarray(self.data.site_xmat[self.world.tip_site]).reshape(3, 3) @ DOWN
        rotation = np.empty(4)
        mujoco.mju_mat2Quat(rotation, np.ascontiguousarray(matrix).ravel())
        return utils.quat(rotation[[1, 2, 3, 0]])

    def pose(self, number: int) -> Pose:
        """Position and rotation (xyzw) of an object."""
        body = self.world.bodies[number]
        w, x, y, z = self.data.xquat[body]
        return utils.vec3(self.data.xpos[body]), utils.quat((x, y, z, w))

    def teleport(self, number: int, pose: Pose) -> None:
        """Set a free object down at a pose, at rest."""
        (position, (x, y, z, w)), start = pose, self.world.addresses[number]
        self.data.qpos[start : start + 7] = (*position, w, x, y, z)
        mujoco.mj_forward(self.model, self.data)

    def step(self, count: int = 1) -> None:
        """Simulate ``count`` time steps; what pulls too hard at the cup meanwhile is let go (``slip``)."""
        self.budget.spend(count)
        if self.held is None and self.observer is None:
            mujoco.mj_step(self.model, self.data, count)
            return
        while count > 0:
            part = 1 if self.observer is not None else min(count, _WATCHED - self._unwatched)
            mujoco.mj_step(self.model, self.data, part)
            if self.observer is not None:
                self.observer()
            count -= part
            self._unwatched += part
            if self._unwatched >= _WATCHED:
                self._unwatched = 0
                if self.held is not None:
                    self._watch(self.held)

    def _watch(self, number: int) -> None:
        """Let go of an object that has pulled too hard at two looks in succession."""
        # The weld also counters the cup's own pushing, so it bounds the load: mostly there is no need to look closer.
        x, y, z = self.data.efc_force[self._weld_row() :][:3].tolist()
        quiet = x * x + y * y + z * z < (0.9 * HOLDING_FORCE) ** 2
        load, before = 0.0 if quiet else self.cup_load(), self._strained
        self._strained = load > HOLDING_FORCE
        if self._strained and before:
            self.release()
            self.slip = Slip(number, load)

    def cup_force(self) -> FloatArray:
        """The force (3,) in newtons, robot frame, with which the cup acts on what it holds: weld and contacts."""
        data, force = self.data, np.zeros(3)
        if self.held is None:
            return force
        row = self._weld_row()
        force -= data.efc_force[row : row + 3]
        wrench, own = np.empty(6), (self.world.cup_body, self.world.bodies[self.held])
        bodies = self.model.geom_bodyid[data.contact.geom] if data.ncon else np.empty((0, 2), dtype=np.int32)
        for row in np.flatnonzero((bodies == own[0]).any(axis=1) & (bodies == own[1]).any(axis=1)):
            mujoco.mj_contactForce(self.model, data, int(row), wrench)
            away = wrench[:3] @ data.contact.frame[row].reshape(3, 3)
            force += away if bodies[row, 1] == own[1] else -away
        return force

    def _weld_row(self) -> int:
        """Where the forces of the weld that holds begin among those of all constraints; equalities come first."""
        if self.data.ne == 6 or self.held is None:
            return 0
        return int(np.argmax(self.data.efc_id[: self.data.ne] == self.world.welds[self.held]))

    def cup_load(self) -> float:
        """How hard what is held pulls at the cup and shears along it, newtons; pressing on it is no load."""
        force, axis = self.cup_force(), np.asarray(self.data.site_xmat[self.world.tip_site]).reshape(3, 3)[:, 2]
        along = float(force @ axis)
        across = force - along * axis
        return float(np.hypot(max(0.0, -along), np.linalg.norm(across)))

    def mass(self, number: int) -> float:
        """Of an object, kg."""
        return float(self.model.body_mass[self.world.bodies[number]])

    def speed(self) -> float:
        """The fastest free body, m/s (turning counts a radian as 0.1 m)."""
        if self.model.nv <= self.dof:
            return 0.0
        velocity = np.abs(self.data.qvel[self.dof :].reshape(-1, 6))
        return float(max(velocity[:, :3].max(), 0.1 * velocity[:, 3:].max()))

    def speed_of(self, number: int) -> float:
        """The speed of one object, m/s (turning counts a radian as 0.1 m); 0 for what cannot move."""
        if number not in self.world.addresses:
            return 0.0
        start = self.model.body_dofadr[self.world.bodies[number]]
        velocity = np.abs(self.data.qvel[start : start + 6])
        return float(max(velocity[:3].max(), 0.1 * velocity[3:].max()))

    def settle(self, seconds: float = 1.2) -> None:
        """Wait until everything rests, at most ``seconds`` of simulated time."""
        chunk = 12
        for _ in range(int(seconds / self.timestep / chunk)):
            self.step(chunk)
            if self.speed() < _STILL:
                return

    def relax(self, seconds: float = 0.8) -> None:
        """Let overlapping bodies part slowly rather than burst: their speed is held down at every step."""
        for _ in range(int(seconds / self.timestep)):
            self.step()
            velocity = self.data.qvel[self.dof :]
            np.clip(velocity, -_GENTLE, _GENTLE, out=velocity)
            if self.data.ncon == 0 or float(self.data.contact.dist.min()) > -0.001:
                return

    def touched(self) -> set[int]:
        """Ids of the objects that the suction cup touches."""
        if self.data.ncon == 0:
            return set()
        pairs = self.data.contact.geom
        rows = pairs[(pairs == self.world.cup_geom).any(axis=1)]
        return {self.world.owners[int(geom)] for geom in rows.ravel()} - {-1}

    def supported(self, number: int) -> bool:
        """Whether something other than the robot holds the object up."""
        if self.data.ncon == 0:
            return False
        owners = np.asarray(self.world.owners)
        pairs = self.data.contact.geom
        mine = (owners[pairs] == number).any(axis=1)
        upright = np.abs(self.data.contact.frame[:, 2]) > 0.7
        robot = (self.model.geom_contype[pairs] == 2).any(axis=1)
        return bool((mine & upright & ~robot).any())

    def grasp(self, number: int) -> None:
        """Switch suction on: the object keeps its present pose relative to the cup."""
        weld, cup, body = self.world.welds[number], self.world.cup_body, self.world.bodies[number]
        back, relative, rotation = np.empty(4), np.empty(3), np.empty(4)
        mujoco.mju_negQuat(back, self.data.xquat[cup])
        mujoco.mju_rotVecQuat(relative, self.data.xpos[body] - self.data.xpos[cup], back)
        mujoco.mju_mulQuat(rotation, back, self.data.xquat[body])
        row = self.model.eq_data[weld]
        row[0:3], row[3:6], row[6:10], row[10] = 0.0, relative, rotation, 1.0
        self.data.eq_active[weld] = 1
        self.held, self.slip = number, None
        self._unwatched, self._strained = 0, False

    def release(self) -> None:
        """Switch suction off."""
        if self.held is not None:
            self.data.eq_active[self.world.welds[self.held]] = 0
        self.held = None

    def follow(self, path: FloatArray, stop: Callable[[], bool] | None = None) -> bool:
        """Drive the arm through joint positions (N, dof), one row a time step.

        Args:
            path: finite joint positions.
            stop: asked at every other step; the arm halts where it is as soon as it is true.

        Returns:
            Whether ``stop`` halted the arm.
        """
        rate = np.gradient(path, self.timestep, axis=0) if len(path) > 1 else np.zeros_like(path)
        commands = path + rate * self._lead
        control, dof = self.data.ctrl, self.dof
        for index, command in enumerate(commands):
            control[:dof] = command
            self.step()
            if stop is not None and index % 2 and stop():
                control[:dof] = self.data.qpos[:dof]
                return True
        control[:dof] = path[-1]
        return False

    def arrive(self, joints: FloatArray, steps: int = 60) -> None:
        """Let the arm, which lags behind a fast motion, come to joint positions (dof,) in at most ``steps`` steps."""
        for _ in range(0, steps, 4):
            if float(np.abs(self.data.qpos[: self.dof] - joints).max()) < _ARRIVED:
                return
            self.step(4)

    def height_below(self, x: float, y: float, top: float = 1.0) -> tuple[float, int]:
        """Where a ray straight down first meets something that can be touched: (height, object id or -1)."""
        distance, owner = self.ray((x, y, top), (0.0, 0.0, -1.0))
        return (0.0, -1) if distance < 0 else (top - distance, owner)

    def ray(self, start: Sequence[float] | FloatArray, direction: Sequence[float] | FloatArray) -> tuple[float, int]:
        """How far off a ray first meets something that can be touched, and its object's id or -1.

        Args:
            start: metres.
            direction: of unit length.

        Returns:
            (metres, id); (-1, -1) where it meets nothing.
        """
        geom = np.array([-1], dtype=np.int32)
        distance = float(
            mujoco.mj_ray(self.model, self.data, np.asarray(start), np.asarray(direction), _SOLID, 1, -1, geom)
        )
        return (distance, self.world.owners[int(geom[0])]) if distance >= 0 else (-1.0, -1)
