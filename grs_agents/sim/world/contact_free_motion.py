"""The arm's way where nothing touches anything: it and what it holds are set along the path, without dynamics."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from grs_agents.geometry import FloatArray
from grs_agents.mujoco_import import mujoco
from grs_agents.sim.arms import DOWN
from grs_agents.sim.world.compilation import World
from grs_agents.sim.world.suction import GRAVITY, Cup

_SPACING: Final = 4
"""Time steps between two rows of a path at which the tip's pose is worked out, all but the last."""
_FARTHEST: Final = 0.016
"""Metres that the tip moves between two looks for contact: about half of what a way keeps clear of things."""
_PER_RADIAN: Final = 0.25
"""Metres that a radian of turning counts as."""
_OFTEN, _SELDOM = 8, 32
"""Time steps between two looks at most: of who feels the way, and else."""
_SHORTEST: Final = 24
"""Time steps: for less of a way it does not pay."""


@dataclass(frozen=True)
class _TipPath:
    """Where the tip and what hangs from it come to at some rows of a path."""

    rows: npt.NDArray[np.int_]  # (K,)
    joints: FloatArray  # (K, dof)
    tips: FloatArray  # (K, 3), metres
    tools: FloatArray  # (K, 3, 3), rotations from the tool straight down


class ContactFreeMotion:
    """Sets an arm, and what its cup holds, along paths.

    A position-controlled arm keeps to its path as long as its joints' torques allow, and an object to the cup as long
    as suction does: both are checked for the whole way before. It ends where anything comes into contact.
    """

    def __init__(self, world: World, data: Any, cup: Cup) -> None:
        self._world, self._model, self._data, self._cup = world, world.model, data, cup
        self._dof = world.arm.dof
        self._trees = sorted(set(self._model.dof_treeid[self._dof :].tolist()))
        limited = np.array(self._model.actuator_forcelimited[: self._dof], dtype=bool)
        self._torques: FloatArray = np.where(limited, self._model.actuator_forcerange[: self._dof, 1], np.inf)

    def can_begin(self) -> bool:
        """Whether nothing touches anything, and nothing but the arm and what it holds is awake."""
        held = self._cup.held
        if self._data.ncon or held in self._world.limp or held in self._world.joined:
            return False
        return int(self._data.tree_awake[self._trees].sum()) == (held is not None)

    def follow(
        self,
        path: FloatArray,
        speeds: FloatArray,
        torques: FloatArray,
        pass_time: Callable[[int], None],
        *,
        feeling: bool = False,
        watched: bool = False,
    ) -> int:
        """Go along joint positions (N, dof), one for each time step from the next one on; ``speeds`` and ``torques``
        (N, dof) are what they ask of the joints. ``pass_time(steps)`` is called after each part of the way, for who
        watches 30 times a second. One who is ``feeling`` the way expects contact.

        Returns how many time steps of it were gone: all, or fewer where something would be touched next; none where
        the dynamics have to say what comes of it.
        """
        if len(path) < _SHORTEST or (np.abs(torques) > self._torques).any():
            return 0
        rows = np.append(np.arange(0, len(path) - 1, _SPACING), len(path) - 1)
        way = _TipPath(rows, path[rows], *self._world.arm.tip_poses(path[rows]))
        if self._cup.held is not None and self._would_let_go(self._cup.held, way):
            return 0
        before, place, last = np.array(self._data.qpos), self._make_placer(way), -1
        for index in _choose_looks(way, _OFTEN if feeling else _SELDOM):
            place(index)
            if self._data.ncon:
                break
            if watched:
                self._show_between(last, index, rows, speeds, place, pass_time)
            else:
                pass_time(_steps_between(last, index, rows))
            last = index
        else:
            self._take_up_speed(path[-1], np.zeros(self._dof))  # a way ends at rest
            return len(path)
        if last < 0:
            self._data.qpos[:] = before
            mujoco.mj_forward(self._model, self._data)
            return 0
        place(last)
        gone = int(rows[last]) + 1
        self._take_up_speed(path[gone - 1], speeds[gone - 1])
        return gone

    def _show_between(
        self,
        last: int,
        end: int,
        rows: npt.NDArray[np.int_],
        speeds: FloatArray,
        place: Callable[[int], None],
        pass_time: Callable[[int], None],
    ) -> None:
        """Pass through every second row after the ``last`` one up to ``end``, for who watches."""
        for index in [*range(last + 2, end, 2), end]:
            place(index)
            self._data.qvel[: self._dof] = speeds[rows[index]]
            pass_time(_steps_between(last, index, rows))
            last = index

    def _would_let_go(self, number: int, way: _TipPath) -> bool:
        """Whether weight and inertia of what is held are more than the cup bears, somewhere on the way."""
        body, data = self._world.bodies[number], self._data
        tip, tool = self._current_tip()
        mass, step = float(self._model.body_mass[body]), _SPACING * float(self._model.opt.timestep)
        levers = (way.tools @ (tool.T @ (data.xipos[body] - tip)))[:-1]  # the last row comes sooner after its previous
        centers: FloatArray = way.tips[:-1] + levers
        x, y, z = (mass / step**2 * (centers[2:] - 2 * centers[1:-1] + centers[:-2])).T
        z = z + mass * GRAVITY
        (i, j, k), (a, b, c) = levers[1:-1].T, way.tools[1:-2, :, 2].T
        pressing: FloatArray = np.minimum(x * a + y * b + z * c, 0.0)
        u, v, w = j * z - k * y, k * x - i * z, i * y - j * x
        twist = u * a + v * b + w * c
        loads: FloatArray = x * x + y * y + z * z - pressing**2
        moments: FloatArray = u * u + v * v + w * w - twist**2
        nozzle = self._cup.nozzle
        return bool(loads.max() > nozzle.holding_force**2 or moments.max() > nozzle.peeling_moment**2)

    def _current_tip(self) -> tuple[FloatArray, FloatArray]:
        """The tip's position (3,), and the tool's rotation (3, 3) from straight down."""
        site, data = self._world.tip_site, self._data
        return np.array(data.site_xpos[site]), np.asarray(data.site_xmat[site]).reshape(3, 3) @ DOWN

    def _make_placer(self, way: _TipPath) -> Callable[[int], None]:
        """Sets the arm and what it holds where they are at a row of the way, and finds what touches there."""
        model, data, held = self._model, self._data, self._cup.held
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

    def _take_up_speed(self, joints: FloatArray, speeds: FloatArray) -> None:
        """Let the dynamics go on from here, the joints moving at ``speeds`` (dof,) and what is held with them."""
        model, data, held = self._model, self._data, self._cup.held
        data.qvel[:] = 0.0
        data.qacc_warmstart[:] = 0.0
        data.qvel[: self._dof] = speeds
        if held is not None and speeds.any():
            step = float(model.opt.timestep)
            tips, tools = self._world.arm.tip_poses(np.array([joints - step * speeds, joints]))
            start, body = int(model.body_dofadr[self._world.bodies[held]]), self._world.bodies[held]
            turn, spin = np.empty(4), np.empty(3)
            mujoco.mju_mat2Quat(turn, np.ascontiguousarray(tools[1] @ tools[0].T).ravel())
            mujoco.mju_quat2Vel(spin, turn, step)
            arm = data.xpos[body] - tips[1]
            data.qvel[start : start + 3] = (tips[1] - tips[0]) / step + np.cross(spin, arm)
            data.qvel[start + 3 : start + 6] = np.asarray(data.xmat[body]).reshape(3, 3).T @ spin
        mujoco.mj_forward(model, data)


def _steps_between(first: int, second: int, rows: npt.NDArray[np.int_]) -> int:
    """Time steps from one row to another; -1 stands for where the way begins."""
    return int(rows[second]) - (int(rows[first]) if first >= 0 else -1)


def _choose_looks(way: _TipPath, longest: int) -> list[int]:
    """At which of its rows to look for contact: the last one, as many as a look's greatest distance asks for, and none
    more than ``longest`` time steps from the one before."""
    moved, turned = np.diff(way.tips, axis=0), np.diff(way.tools, axis=0)
    steps: FloatArray = np.sqrt((moved * moved).sum(axis=1))
    steps += _PER_RADIAN * np.sqrt((turned * turned).sum(axis=(1, 2)) / 2)  # the angle, as long as it is small
    parts: FloatArray = np.maximum(steps / _FARTHEST, np.diff(way.rows) / longest)
    gone = np.floor(np.cumsum(parts))
    return [*np.flatnonzero(gone[1:] > gone[:-1]).tolist(), len(way.rows) - 1]
