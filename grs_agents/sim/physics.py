"""Stepping a world: a budget of simulated steps, settling, contacts, suction, and arm paths."""

from collections.abc import Callable, Sequence
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from grs_agents.base import Pose, Vec3
from grs_agents.sim import kinematics, utils
from grs_agents.sim.engine import mujoco
from grs_agents.sim.episode import SimulationBudgetError
from grs_agents.sim.instance import InstanceObject
from grs_agents.sim.robot import HOME
from grs_agents.sim.world import World, place

FloatArray = npt.NDArray[np.float64]
DEFAULT_BUDGET: Final = 500_000
_STILL: Final = 0.01
_ARRIVED: Final = 0.002
"""Radians from the end of a motion at which the next one begins: 1 mm of the tip."""
_GENTLE: Final = 0.15
"""Fastest a body may be pushed out of another while the scene settles at reset, m/s."""


def home_joints() -> FloatArray:
    """Joint angles (6,) of the waiting arm, radians."""
    return kinematics.solve(np.array([HOME]), np.zeros(1))[0]


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
        objects: where everything stands.
        joints: joint angles (6,) to start from, None for home.
    """

    def __init__(
        self, world: World, budget: Budget, objects: Sequence[InstanceObject], joints: FloatArray | None = None
    ) -> None:
        self.world, self.budget = world, budget
        self.model: Any = world.model
        self.data: Any = mujoco.MjData(self.model)
        place(world, self.data, objects)
        self.timestep = float(self.model.opt.timestep)
        if joints is None:
            joints = home_joints()
        self.data.qpos[:6] = joints
        self.data.ctrl[:6] = joints
        gain = self.model.actuator_gainprm[:6, 0]
        self._lead: FloatArray = -self.model.actuator_biasprm[:6, 2] / gain
        self.held: int | None = None
        self.observer: Callable[[], None] | None = None
        mujoco.mj_forward(self.model, self.data)

    @property
    def joints(self) -> FloatArray:
        """Joint angles (6,), radians."""
        return np.array(self.data.qpos[:6])

    @property
    def tip(self) -> Vec3:
        """Where the suction cup is, metres."""
        return utils.vec3(self.data.site_xpos[self.world.tip_site])

    def tip_yaw(self) -> float:
        """The tool's turn about the vertical, radians."""
        matrix = self.data.site_xmat[self.world.tip_site]
        return float(np.arctan2(matrix[3], matrix[0]))

    def pose(self, number: int) -> Pose:
        """Position and rotation (xyzw) of an object."""
        body = self.world.bodies[number]
        w, x, y, z = self.data.xquat[body].tolist()
        return utils.vec3(self.data.xpos[body].tolist()), utils.quat((x, y, z, w))

    def snapshot(self) -> Any:
        """A copy of the whole state, sleep included, for ``restore``."""
        saved = mujoco.MjData(self.model)
        mujoco.mj_copyData(saved, self.model, self.data)
        return saved

    def restore(self, saved: Any) -> None:
        """Take up a state that ``snapshot`` gave, of the same model."""
        mujoco.mj_copyData(self.data, self.model, saved)

    def teleport(self, number: int, pose: Pose) -> None:
        """Set a free object down at a pose, at rest."""
        (position, (x, y, z, w)), start = pose, self.world.addresses[number]
        self.data.qpos[start : start + 7] = (*position, w, x, y, z)
        mujoco.mj_forward(self.model, self.data)

    def step(self, count: int = 1) -> None:
        """Simulate ``count`` time steps."""
        self.budget.spend(count)
        if self.observer is None:
            mujoco.mj_step(self.model, self.data, count)
            return
        for _ in range(count):
            mujoco.mj_step(self.model, self.data)
            self.observer()

    def speed(self) -> float:
        """The fastest free body, m/s (turning counts a radian as 0.1 m)."""
        if self.model.nv <= 6:
            return 0.0
        velocity = np.abs(self.data.qvel[6:].reshape(-1, 6))
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
            velocity = self.data.qvel[6:]
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
        self.held = number

    def release(self) -> None:
        """Switch suction off."""
        if self.held is not None:
            self.data.eq_active[self.world.welds[self.held]] = 0
        self.held = None

    def follow(self, path: FloatArray, stop: Callable[[], bool] | None = None) -> bool:
        """Drive the arm through joint angles (N, 6), one row a time step.

        Args:
            path: finite joint angles, radians.
            stop: asked at every other step; the arm halts where it is as soon as it is true.

        Returns:
            Whether ``stop`` halted the arm.
        """
        rate = np.gradient(path, self.timestep, axis=0) if len(path) > 1 else np.zeros_like(path)
        commands = path + rate * self._lead
        control = self.data.ctrl
        for index, command in enumerate(commands):
            control[:6] = command
            self.step()
            if stop is not None and index % 2 and stop():
                control[:6] = self.data.qpos[:6]
                return True
        control[:6] = path[-1]
        return False

    def arrive(self, joints: FloatArray, steps: int = 60) -> None:
        """Let the arm, which lags behind a fast motion, come to joint angles (6,), at most ``steps`` time steps."""
        for _ in range(0, steps, 4):
            if float(np.abs(self.data.qpos[:6] - joints).max()) < _ARRIVED:
                return
            self.step(4)

    def height_below(self, x: float, y: float, top: float = 1.0) -> tuple[float, int]:
        """Where a ray straight down first meets something that can be touched: (height, object id or -1)."""
        geom = np.array([-1], dtype=np.int32)
        groups = np.array([1, 0, 0, 1, 0, 0], dtype=np.uint8)
        start, down = np.array([x, y, top]), np.array([0.0, 0.0, -1.0])
        distance = float(mujoco.mj_ray(self.model, self.data, start, down, groups, 1, -1, geom))
        if distance < 0:
            return 0.0, -1
        return top - distance, self.world.owners[int(geom[0])]
