"""A running world: stepping, settling, contacts, suction and arm paths."""

from collections.abc import Callable, Sequence
from typing import Any, Final

import numpy as np

from grs_agents.base import Pose, Quat, Vec3
from grs_agents.base.geometry import transforms
from grs_agents.base.geometry.transforms import FloatArray
from grs_agents.base.mujoco_import import mujoco
from grs_agents.sim.arms.arm_parts import DOWN
from grs_agents.sim.arms.joint_paths import WAYPOINT_STEPS
from grs_agents.sim.hands.hand import ROBOT_CONTYPE
from grs_agents.sim.hands.two_fingers import FRANKA_HAND
from grs_agents.sim.instance.episode import SimulationError
from grs_agents.sim.instance.task_instance import InstanceObject
from grs_agents.sim.world.budget import Budget
from grs_agents.sim.world.compilation import World, reset_world_to_poses
from grs_agents.sim.world.contact_free_motion import ContactFreeMotion
from grs_agents.sim.world.fingers import Fingers
from grs_agents.sim.world.grip import Grip, is_supported
from grs_agents.sim.world.joint_way import pace_legs
from grs_agents.sim.world.suction import Cup

_STILL: Final = 0.01
"""Speed below which a body is at rest, m/s."""
_GLANCE, _SURGE = 4, 0.2
"""Steps that tell whether a placed scene is at rest, and share of ``_STILL`` that a body may gain in a step."""
_ARRIVED: Final = 0.002
"""Joint error at which the next motion begins, radians: 1 mm of the tip."""
_FREE_STRIDE, _HELD_STRIDE = 8, 2
"""Time steps of an arm command, with an empty cup and with a held object; commands are interpolated. With four steps, a
tall carton held 5 mm off centre tipped off the cup in 10 of 60 trials."""
_AGAIN: Final = 16
"""Time steps of dynamics after which kinematic motion is tried again."""
_GENTLE: Final = 0.15
"""Largest speed at which overlapping bodies are pushed apart while the scene settles, m/s."""
_WARNINGS: Final = (
    "a body without inertia",
    "too many contacts",
    "too many constraints",
    "positions out of bounds",
    "speeds out of bounds",
    "accelerations out of bounds",
    "controls out of bounds",
)
"""Meanings of MuJoCo's warnings, in their order."""
_CROWD: Final = 24
_MOST_CONTACTS: Final = 4000
"""Most contacts of a scene with more than ``_CROWD`` free bodies: 200 grains in a heap have 1500."""
_SOLID: Final = np.array([1, 0, 0, 1, 0, 0], dtype=np.uint8)
"""Geom groups that rays hit: objects' colliders and the table, not the arm."""


class Physics:
    """A running world; its arm starts at ``joints`` (dof,), None for home."""

    def __init__(
        self, world: World, budget: Budget, objects: Sequence[InstanceObject], joints: FloatArray | None = None
    ) -> None:
        self.world, self.budget = world, budget
        self.model: Any = world.model
        self.data: Any = world.data
        self._positions, self._turns = self.data.xpos, self.data.xquat  # views, of every body
        self._poses: dict[
            int, tuple[list[float], list[float], Pose]
        ] = {}  # poses of objects, with the state they were made from
        reset_world_to_poses(world, objects)
        self.timestep = float(self.model.opt.timestep)
        self.waypoint_seconds = WAYPOINT_STEPS * self.timestep
        self.arm, self.dof, self._free = world.arm, world.arm.dof, world.first_free
        if joints is None:
            joints = self.arm.home_joints
        self.data.qpos[: self.dof] = joints
        self._command: Any = self.data.act[: self.dof]
        self._control: Any = self.data.ctrl[: self.dof]
        self._warnings: Any = self.data.warning.number
        self._command[:] = joints
        self._stiffness: FloatArray = np.array(self.model.actuator_gainprm[: self.dof, 0])
        self._lead: FloatArray = -self.model.actuator_biasprm[: self.dof, 2] / self._stiffness
        self.grip: Grip = Cup(world, self.data) if world.fingers is None else Fingers(world, self.data)
        self._contact_free = ContactFreeMotion(world, self.data, self.grip)
        self._ray, self._met = np.empty((2, 3)), np.array([-1], dtype=np.int32)  # buffers: a search casts many rays
        self.observer: Callable[[], None] | None = None
        self.observer_period = 1  # time steps between two calls of the observer
        self._unobserved = 0
        self.diverged_at: float | None = None  # simulated time, seconds
        if len(world.addresses) > _CROWD:  # many bodies inside each other would take minutes a step
            mujoco.mj_kinematics(self.model, self.data)
            mujoco.mj_comPos(self.model, self.data)
            mujoco.mj_collision(self.model, self.data)
            if self.data.ncon > _MOST_CONTACTS:
                found = f"{len(world.addresses)} objects have {self.data.ncon} contacts, {_MOST_CONTACTS} are the most"
                raise SimulationError(found, "place objects apart from one another")
        mujoco.mj_forward(self.model, self.data)

    @property
    def cup(self) -> Cup:
        """The suction of the hand."""
        if not isinstance(self.grip, Cup):
            raise SimulationError(f"the hand {self.arm.hand.name} has no suction cup", "set hand = 'suction'")
        return self.grip

    @property
    def fingers(self) -> Fingers:
        """The fingers of the hand."""
        if not isinstance(self.grip, Fingers):
            raise SimulationError(f"the hand {self.arm.hand.name} has no fingers", f"set hand = '{FRANKA_HAND.name}'")
        return self.grip

    @property
    def joint_positions(self) -> FloatArray:
        """Joint positions (dof,) of the arm: radians, or metres of a slide."""
        return np.array(self.data.qpos[: self.dof])

    @property
    def robot_positions(self) -> FloatArray:
        """Joint positions of the arm (dof,), then those of the fingers of its hand (m), if it has any."""
        return np.array(self.data.qpos[: self._free])

    @property
    def commanded_joint_positions(self) -> FloatArray:
        """Joint positions (dof,) commanded now."""
        return np.array(self._command)

    @property
    def tip_position(self) -> Vec3:
        """Position of the tip, metres."""
        return transforms.to_vec3(self.data.site_xpos[self.world.tip_site])

    def tip_rotation(self) -> Quat:
        """Rotation of the tool from straight down, xyzw."""
        matrix = self.data.site_xmat[self.world.tip_site].reshape(3, 3) @ DOWN
        rotation = np.empty(4)
        mujoco.mju_mat2Quat(rotation, matrix.ravel())
        w, x, y, z = rotation.tolist()
        return transforms.to_unit_quaternion((x, y, z, w))

    def object_pose(self, number: int) -> Pose:
        """Position and rotation (xyzw) of an object."""
        body = self.world.bodies[number]
        position, turn = self._positions[body].tolist(), self._turns[body].tolist()
        known = self._poses.get(number)
        if known is None or known[0] != position or known[1] != turn:  # most objects have not moved
            (x, y, z), (w, i, j, k) = position, turn
            known = (position, turn, ((x, y, z), transforms.to_unit_quaternion((i, j, k, w))))
            self._poses[number] = known
        return known[2]

    def raise_if_diverged(self) -> None:
        """Raise ``SimulationError`` if the simulation has diverged, or had too many contacts.

        MuJoCo itself would reset to the model's initial state and go on.
        """
        if np.count_nonzero(self._warnings):
            causes = ", ".join(_WARNINGS[index] for index in np.flatnonzero(self._warnings))
            remedy = "do not start objects inside each other, and do not tie together what cannot be"
            moment = self.data.time if self.diverged_at is None else self.diverged_at
            raise SimulationError(f"the physics diverged at {moment:.2f} s: {causes}", remedy)

    def save_state(self, onto: Any = None) -> Any:
        """A copy of the whole state, sleep included, for ``restore_state``; ``onto``: an older copy to replace."""
        saved = mujoco.MjData(self.model) if onto is None else onto
        mujoco.mj_copyData(saved, self.model, self.data)
        return saved

    def restore_state(self, saved: Any) -> None:
        """Restore a state of ``save_state``, of the same model."""
        mujoco.mj_copyData(self.data, self.model, saved)

    def teleport_object(self, number: int, pose: Pose) -> None:
        """Set a free object to a pose, at rest."""
        (position, (x, y, z, w)), start = pose, self.world.addresses[number]
        self.data.qpos[start : start + 7] = (*position, w, x, y, z)
        mujoco.mj_forward(self.model, self.data)

    def step(self, count: int = 1) -> None:
        """Simulate ``count`` time steps; an object that overloads the hand is released (``grip.slip``)."""
        self.budget.spend_steps(count)
        grip, observer, data = self.grip, self.observer, self.data
        while count > 0:
            part = count if grip.held is None else min(count, grip.due)
            if observer is not None:
                part = min(part, self.observer_period - self._unobserved)
            expected = data.time + part * self.timestep
            mujoco.mj_step(self.model, data, part)
            if data.time < expected - self.timestep / 2 and self.diverged_at is None:
                self.diverged_at = expected - data.time  # after divergence MuJoCo begins anew at 0
            if observer is not None:
                self._count_unobserved(part)
            count -= part
            if grip.held is not None:
                grip.release_if_overloaded(part)

    def _count_unobserved(self, steps: int) -> None:
        """Count time steps, and call the observer when it is due."""
        if self.observer is not None:
            self._unobserved += steps
            if self._unobserved >= self.observer_period:
                self._unobserved = 0
                self.observer()

    def lead_arm(self, joints: FloatArray, count: int, within: int = 0, stop: Callable[[], bool] | None = None) -> int:
        """Step ``count`` times while the commanded joint positions move evenly towards ``joints`` (dof,).

        They arrive after ``within`` time steps, at least ``count``. With ``stop``, called after each step, until it
        holds. Returns: time steps simulated.
        """
        control, left, part = self._control, max(count, within), count if stop is None else 1
        end = left - count
        while left > end:
            np.subtract(joints, self._command, control)
            np.divide(control, left * self.timestep, control)
            self.step(part)
            left -= part
            if stop is not None and stop():
                break
        control[:] = 0.0
        return count + end - left

    def hold_arm(self, joints: FloatArray) -> None:
        """Command constant joint positions (dof,)."""
        self._command[:] = joints

    def object_mass(self, number: int) -> float:
        """Mass of an object and everything rigidly tied to it, kg."""
        return float(self.model.body_mass[self._bodies_tied_to_object(number)].sum())

    def center_of_mass(self, number: int) -> Vec3:
        """Centre of mass of an object and everything rigidly tied to it, metres."""
        bodies = self._bodies_tied_to_object(number)
        if len(bodies) == 1:  # a fixed body may have no mass
            return transforms.to_vec3(self.data.xipos[bodies[0]])
        weights: FloatArray = self.model.body_mass[bodies]
        return transforms.to_vec3(weights @ self.data.xipos[bodies] / weights.sum())

    def _bodies_tied_to_object(self, number: int) -> list[int]:
        return [self.world.bodies[member] for member in self.world.joined.get(number, (number,))]

    def max_free_body_speed(self) -> float:
        """Speed of the fastest free body, m/s (a radian counts as 0.1 m)."""
        return self._max_speed(self.data.qvel[self._free :])

    def _max_speed(self, velocities: FloatArray) -> float:
        if not len(velocities):
            return 0.0
        velocity = np.abs(velocities.reshape(-1, 6))
        return float(max(velocity[:, :3].max(), 0.1 * velocity[:, 3:].max()))

    @property
    def is_asleep(self) -> bool:
        """Whether MuJoCo has put every free body to sleep: nothing moves by itself any more."""
        return not self.data.tree_awake[self.model.dof_treeid[self._free :]].any()

    def object_speed(self, number: int) -> float:
        """Speed of an object, m/s (a radian counts as 0.1 m); 0 for a fixed object."""
        if number not in self.world.addresses:
            return 0.0
        start = self.model.body_dofadr[self.world.bodies[number]]
        return self._max_speed(self.data.qvel[start : start + 6])

    def simulate_until_at_rest(self, seconds: float = 1.2) -> None:
        """Wait until everything rests, at most ``seconds`` of simulated time; errors as ``raise_if_diverged``."""
        chunk = 12
        if not self.is_asleep:
            # A scene that is slow and gathers no speed, by falling, tipping or rolling, rests already.
            self.step(_GLANCE - 1)
            before = np.array(self.data.qvel[self._free :])
            self.step()
            surge = self._max_speed(self.data.qvel[self._free :] - before)
            if not max(self.max_free_body_speed(), surge / _SURGE) < _STILL:  # also for NaN
                for _ in range(int(seconds / self.timestep / chunk)):
                    self.step(chunk)
                    if self.max_free_body_speed() < _STILL:
                        break
        self.raise_if_diverged()

    def wait_until_asleep(self, least: int, most: int) -> None:
        """Wait for ``least`` time steps, and up to ``most`` while anything moves by itself."""
        self.step(least)
        while least < most and not self.is_asleep:
            self.step(_GLANCE)
            least += _GLANCE

    def separate_overlapping_bodies(self, seconds: float = 0.8) -> None:
        """Let overlapping bodies part slowly: their speed is clamped at every step."""
        velocity = self.data.qvel[self._free :]
        for _ in range(int(seconds / self.timestep)):
            if self.data.ncon == 0 or float(self.data.contact.dist.min()) > -0.001:
                return
            self.step()
            np.clip(velocity, -_GENTLE, _GENTLE, out=velocity)

    def objects_touching_cup(self) -> set[int]:
        """Ids of the objects that the suction cup touches."""
        if self.data.ncon == 0:
            return set()
        pairs = self.data.contact.geom
        if self.world.cup_geom not in pairs:
            return set()
        rows = pairs[(pairs == self.world.cup_geom).any(axis=1)]
        return {self.world.owners[int(geom)] for geom in rows.ravel()} - {-1}

    def objects_touching_object(self, number: int) -> set[int]:
        """Ids of the objects that an object touches."""
        owners = self.world.owner_of_geom[self.data.contact.geom]
        return set(owners[(owners == number).any(axis=1)].ravel().tolist()) - {-1, number}

    def unheld_objects_touching_robot(self) -> set[int]:
        """Ids of the objects that any part of the robot touches, without the held object."""
        if self.data.ncon == 0:
            return set()
        pairs = self.data.contact.geom
        rows = pairs[(self.model.geom_contype[pairs] == ROBOT_CONTYPE).any(axis=1)]
        return {self.world.owners[int(geom)] for geom in rows.ravel()} - {-1, self.held_object_id}

    def is_object_supported(self, number: int) -> bool:
        """Whether anything but the robot supports the object."""
        return is_supported(self.world, self.data, number)

    @property
    def held_object_id(self) -> int | None:
        """Id of the object in the hand; None for an empty hand."""
        return self.grip.held

    def compensate_joint_damping(self, path: FloatArray, speeds: FloatArray) -> FloatArray:
        """Commands for joint positions, both (..., dof), at ``speeds`` (..., dof), with the lag of the joints' damping
        compensated."""
        return path + speeds * self._lead

    def follow_joint_path(self, *legs: FloatArray, stop: Callable[[], bool] | None = None, spacing: int = 1) -> bool:
        """Drive the arm along legs of joint positions (N, dof), at rest between legs.

        Positions are ``spacing`` time steps apart (1 or ``WAYPOINT_STEPS``), more where joint speed limits demand it.
        With ``stop`` the arm feels its way along the last leg; ``stop`` may hold only where something is in contact.
        Without contacts the motion is kinematic, otherwise dynamic.

        Returns: True if it ended early: the hand let go, or ``stop`` held.
        """
        held = self.grip.held
        way = pace_legs(legs, self.arm, self.timestep, spacing, self.commanded_joint_positions)
        feeling = way.steps + 1 if stop is None else way.last_leg * WAYPOINT_STEPS
        gone = again = 0
        while gone < way.steps:
            if gone >= again and gone % WAYPOINT_STEPS == 0 and self._contact_free.can_begin():
                passed = self._contact_free.follow(
                    way.since(gone // WAYPOINT_STEPS),
                    self.pass_time,
                    feeling=stop is not None,
                    watched=self.observer is not None,
                )
                gone += passed
                again = gone + _AGAIN
                if passed:
                    self.grip.watch_anew()
                    self.hold_arm(way.command_at(gone, self._lead, self._stiffness))
                    continue
            if self.grip.held is None:
                stride = _HELD_STRIDE if gone >= feeling else _FREE_STRIDE
            else:
                stride = 1 if gone >= feeling else _HELD_STRIDE
            count = min(stride, way.steps - gone)
            gone += count
            self.lead_arm(way.command_at(gone, self._lead, self._stiffness), count)
            if self.grip.held != held or (stop is not None and gone > feeling and stop()):
                self.hold_arm(self.joint_positions)
                return True
        self.hold_arm(way.joints[-1])
        return False

    def pass_time(self, steps: int) -> None:
        """Count time steps of kinematic motion."""
        self.budget.spend_steps(steps)
        self.data.time += steps * self.timestep
        self._count_unobserved(steps)

    def wait_for_joint_positions(self, joints: FloatArray, steps: int = 60) -> None:
        """Let the arm catch up with its commanded joint positions (dof,), for at most ``steps`` time steps."""
        for _ in range(0, steps, 4):
            if float(np.abs(self.data.qpos[: self.dof] - joints).max()) < _ARRIVED:
                return
            self.step(4)

    def surface_height_below(self, x: float, y: float, top: float = 1.0) -> tuple[float, int]:
        """First hit of a ray straight down: (height, object id or -1)."""
        distance, owner = self.cast_ray((x, y, top), (0.0, 0.0, -1.0))
        return (0.0, -1) if distance < 0 else (top - distance, owner)

    def cast_ray(
        self, start: Sequence[float] | FloatArray, direction: Sequence[float] | FloatArray
    ) -> tuple[float, int]:
        """First hit of a ray with a unit ``direction``: (distance in metres, object id or -1); (-1, -1) for no hit."""
        (origin, way), geom = self._ray, self._met
        origin[:], way[:] = start, direction
        distance = float(mujoco.mj_ray(self.model, self.data, origin, way, _SOLID, 1, -1, geom))
        return (distance, self.world.owners[int(geom[0])]) if distance >= 0 else (-1.0, -1)
