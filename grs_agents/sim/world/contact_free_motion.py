"""Kinematic motion where nothing is in contact: arm and held object are set along a path, without dynamics."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from grs_agents.base.geometry.transforms import FloatArray
from grs_agents.base.mujoco_import import mujoco
from grs_agents.sim.arms.arm_parts import DOWN
from grs_agents.sim.arms.joint_paths import WAYPOINT_STEPS
from grs_agents.sim.hands.hand import GRAVITY
from grs_agents.sim.world.compilation import World
from grs_agents.sim.world.grip import Grip
from grs_agents.sim.world.joint_way import JointWay

_FARTHEST: Final = 0.016
"""Farthest that the tip moves between two contact checks, metres: about half the clearance of a path."""
_PER_RADIAN: Final = 0.25
"""Metres of tip motion that a radian of rotation counts as."""
_OFTEN, _SELDOM = 8, 32
"""Most time steps between two contact checks: on a leg that feels its way, and elsewhere."""
_SHORTEST: Final = 6
"""Fewest way points for which kinematic motion pays."""


@dataclass(frozen=True)
class _TipPath:
    """Poses of the tip at the way points of a path."""

    joints: FloatArray  # (K, dof)
    tips: FloatArray  # (K, 3), metres
    tools: FloatArray  # (K, 3, 3), rotations from the tool pointing straight down


class ContactFreeMotion:
    """Sets an arm, and the object in its hand, along paths.

    A position-controlled arm keeps to its path within its torque limits, and the hand keeps an object within its
    limits; both are checked for the whole path first. Motion ends where anything comes into contact.
    """

    def __init__(self, world: World, data: Any, grip: Grip) -> None:
        self._world, self._model, self._data, self._grip = world, world.model, data, grip
        self._dof = world.arm.dof
        self._trees = sorted(set(self._model.dof_treeid[world.first_free :].tolist()))
        limited = np.array(self._model.actuator_forcelimited[: self._dof], dtype=bool)
        self._torques: FloatArray = np.where(limited, self._model.actuator_forcerange[: self._dof, 1], np.inf)

    def can_begin(self) -> bool:
        """Whether nothing is in contact, and nothing but the arm and the object it holds is awake."""
        held = self._grip.held
        if self._grip.meets_anything_else() or held in self._world.limp or held in self._world.joined:
            return False
        return int(self._data.tree_awake[self._trees].sum()) == (held is not None)

    def follow(
        self,
        way: JointWay,
        pass_time: Callable[[int], None],
        *,
        feeling: bool = False,
        watched: bool = False,
    ) -> int:
        """Follow a path.

        Args:
            way: the path.
            pass_time: called with the time steps of each part that was followed.
            feeling: contact is expected on the last leg.
            watched: stop at every second way point, for an observer at 30 Hz.

        Returns:
            Time steps followed: all, fewer where contact comes next, 0 where the dynamics must decide.
        """
        if len(way.joints) < _SHORTEST or (np.abs(way.torques) > self._torques).any():
            return 0
        path = _TipPath(way.joints, *self._world.arm.tip_poses(way.joints))
        if self._grip.held is not None and self._is_grip_overloaded(self._grip.held, path, way.seconds):
            return 0
        before, place, last = np.array(self._data.qpos), self._make_placer(path), 0
        slow = way.last_leg if feeling else len(path.tips)
        for look in _choose_checked_waypoints(path, slow):
            free = last  # at full speed the arm needs the way before a contact to meet it under the dynamics
            for index in (look, *range(look - 1, max(last, slow), -1)):
                place(index)
                if not self._grip.meets_anything_else():
                    free = index
                    break
            if watched and free > last:
                for index in [*range(last + 2, free, 2), free]:
                    place(index)
                    self._data.qvel[: self._dof] = way.speeds[index]
                    pass_time(WAYPOINT_STEPS * (index - last))
                    last = index
            last = free
            if free < look:
                break
        steps = WAYPOINT_STEPS * last
        if not watched:
            pass_time(steps)
        if steps == way.steps:
            self._take_up_speed(way.joints[-1], None)
        elif last:
            place(last)
            self._take_up_speed(way.joints[last], way.speeds[last])
        else:
            self._data.qpos[:] = before
            mujoco.mj_forward(self._model, self._data)
        return steps

    def _is_grip_overloaded(self, number: int, way: _TipPath, step: float) -> bool:
        """Whether weight and inertia of the held object tear it from the hand anywhere on the path."""
        body, data = self._world.bodies[number], self._data
        tip, tool = self._current_tip()
        mass = float(self._model.body_mass[body])
        levers = way.tools @ (tool.T @ (data.xipos[body] - tip))
        centers: FloatArray = way.tips + levers
        forces: FloatArray = mass / step**2 * (centers[2:] - 2 * centers[1:-1] + centers[:-2])
        forces[:, 2] += mass * GRAVITY
        return self._grip.would_lose(forces, levers[1:-1], way.tools[1:-1, :, 2])

    def _current_tip(self) -> tuple[FloatArray, FloatArray]:
        """Position (3,) of the tip, and rotation (3, 3) of the tool from straight down."""
        site, data = self._world.tip_site, self._data
        return np.array(data.site_xpos[site]), np.asarray(data.site_xmat[site]).reshape(3, 3) @ DOWN

    def _make_placer(self, way: _TipPath) -> Callable[[int], None]:
        """Function that sets the arm and the held object to a way point, and finds the contacts there."""
        model, data, held = self._model, self._data, self._grip.held
        arm, joints = data.qpos[: self._dof], way.joints
        if held is None:

            def place_arm(index: int) -> None:
                arm[:] = joints[index]
                mujoco.mj_kinematics(model, data)
                mujoco.mj_collision(model, data)

            return place_arm
        body, start = self._world.bodies[held], self._world.addresses[held]
        tip, tool = self._current_tip()
        origins: FloatArray = way.tips + way.tools @ (tool.T @ (data.xpos[body] - tip))
        turns = way.tools @ (tool.T @ np.asarray(data.xmat[body]).reshape(3, 3))
        turns = np.ascontiguousarray(turns).reshape(-1, 9)
        position, rotation = data.qpos[start : start + 3], data.qpos[start + 3 : start + 7]

        def place_arm_and_object(index: int) -> None:
            arm[:] = joints[index]
            position[:] = origins[index]
            mujoco.mju_mat2Quat(rotation, turns[index])
            mujoco.mj_kinematics(model, data)
            mujoco.mj_collision(model, data)

        return place_arm_and_object

    def _take_up_speed(self, joints: FloatArray, speeds: FloatArray | None) -> None:
        """Hand over to the dynamics, the joints and the held object moving at ``speeds`` (dof,); None for at rest."""
        model, data, held = self._model, self._data, self._grip.held
        data.qvel[:] = 0.0
        data.qacc_warmstart[:] = 0.0
        if speeds is not None:
            data.qvel[: self._dof] = speeds
        if held is not None and speeds is not None:
            step = float(model.opt.timestep)
            tips, tools = self._world.arm.tip_poses(np.array([joints - step * speeds, joints]))
            start, body = int(model.body_dofadr[self._world.bodies[held]]), self._world.bodies[held]
            turn, spin = np.empty(4), np.empty(3)
            mujoco.mju_mat2Quat(turn, np.ascontiguousarray(tools[1] @ tools[0].T).ravel())
            mujoco.mju_quat2Vel(spin, turn, step)
            (u, v, w), (x, y, z) = spin.tolist(), (data.xpos[body] - tips[1]).tolist()
            swept = (v * z - w * y, w * x - u * z, u * y - v * x)
            data.qvel[start : start + 3] = (tips[1] - tips[0]) / step + swept
            data.qvel[start + 3 : start + 6] = np.asarray(data.xmat[body]).reshape(3, 3).T @ spin
        mujoco.mj_forward(model, data)


def _choose_checked_waypoints(way: _TipPath, feeling: int) -> list[int]:
    """Way points to check for contact: the last, and as many as the greatest distance between two checks demands.

    Checks are at most ``_SELDOM`` time steps apart, ``_OFTEN`` from the way point ``feeling`` on.
    """
    moved, tools = way.tips[1:] - way.tips[:-1], way.tools.reshape(-1, 9)
    turned = tools[1:] - tools[:-1]
    parts: FloatArray = np.sqrt(np.einsum("ni,ni->n", moved, moved))
    parts += _PER_RADIAN * np.sqrt(np.einsum("ni,ni->n", turned, turned) / 2)  # the angle, as long as it is small
    parts /= _FARTHEST
    least = np.full(len(parts), WAYPOINT_STEPS / _SELDOM)
    least[feeling:] = WAYPOINT_STEPS / _OFTEN
    gone = np.floor(np.maximum(parts, least).cumsum())
    looks: list[int] = (gone[1:] > gone[:-1]).nonzero()[0].tolist()
    return [*(index for index in looks if index), len(way.tips) - 1]
