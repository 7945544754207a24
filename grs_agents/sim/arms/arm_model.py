"""An arm alone in MuJoCo: forward and inverse kinematics, and collisions with the table and itself."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from grs_agents.base.geometry.transforms import FloatArray
from grs_agents.base.mujoco_import import mujoco
from grs_agents.sim.arms.arm_parts import DOWN

_TOLERANCE: Final = 1e-4
"""Convergence tolerance, metres and radians."""
_DAMPING: Final = 1e-4 * np.eye(6)
_HOMEWARD: Final = 0.05
_STALLED: Final = 1e-6
"""Change of the joints per iteration below which the solver has stalled, radians or metres."""
_LONGEST: Final = 0.35
"""Largest change of a joint per iteration, radians."""
_FLOOR: Final = "world"


@dataclass(frozen=True)
class Collision:
    """Two colliding bodies: their names and penetration depth (m)."""

    first: str
    second: str
    depth: float

    def __str__(self) -> str:
        other = "the table" if self.first == _FLOOR else f"its own {self.first.replace('_', ' ')}"
        return f"its {self.second.replace('_', ' ')} would reach {self.depth:.3f} m into {other}"


class ArmModel:
    """A compiled arm above the table; ``apart`` are pairs of bodies that touch by design, ``hand`` is at the flange."""

    def __init__(self, add: Callable[[Any], None], apart: Sequence[tuple[str, str]] = (), hand: str = "cup") -> None:
        spec = mujoco.MjSpec()
        spec.compiler.degree = False
        table = spec.worldbody.add_geom(name="table", type=mujoco.mjtGeom.mjGEOM_PLANE, size=(2, 2, 0.1))
        add(spec)
        for geom in spec.geoms:
            solid = geom is not table and (geom.contype or geom.conaffinity)
            geom.contype, geom.conaffinity, geom.margin, geom.gap = (1, 1, 0.0, 0.0) if solid else (0, 0, 0.0, 0.0)
        table.contype = table.conaffinity = 1
        for first, second in (("world", hand), *apart):
            spec.add_exclude(bodyname1=first, bodyname2=second)
        self._model: Any = spec.compile()
        self._data: Any = mujoco.MjData(self._model)
        self._site = int(self._model.site("tip").id)
        self.dof = int(self._model.nq)
        self.low, self.high = np.array(self._model.jnt_range[:, 0]), np.array(self._model.jnt_range[:, 1])
        self.slides = np.array(self._model.jnt_type) == int(mujoco.mjtJoint.mjJNT_SLIDE)
        self.links = tuple(str(self._model.body(number).name) for number in range(1, self._model.nbody))
        self._jacobian = np.zeros((6, self.dof))
        self._tip, self._tool = self._data.site_xpos[self._site], self._data.site_xmat[self._site]  # views
        self._placed = b""  # the joints of the present kinematics

    def _place(self, joints: FloatArray) -> None:
        """Compute the kinematics at joint positions (dof,), if they are not the present ones."""
        if (key := joints.tobytes()) != self._placed:
            self._data.qpos[:] = joints
            mujoco.mj_kinematics(self._model, self._data)
            self._placed = key

    def has_vertical_base_hinge(self) -> bool:
        """Whether the first joint turns the whole arm about the vertical through the origin."""
        model, data = self._model, self._data
        mujoco.mj_kinematics(model, data)
        upright = abs(float(data.xaxis[0, 2])) > 0.9999 and float(np.hypot(*data.xanchor[0, :2])) < 1e-6
        return upright and int(model.jnt_type[0]) == int(mujoco.mjtJoint.mjJNT_HINGE)

    def is_within_span(self, tip: FloatArray, tool: FloatArray) -> bool:
        """Whether the links, stretched from the first hinge, are long enough for a pose of the tip; True for slides."""
        model, data = self._model, self._data
        if self.slides.any():
            return True
        mujoco.mj_kinematics(model, data)
        anchors, present = np.array(data.xanchor), np.array(data.site_xmat[self._site]).reshape(3, 3)
        last = tip - tool @ present.T @ (data.site_xpos[self._site] - anchors[-1])
        span = float(np.linalg.norm(np.diff(anchors, axis=0), axis=1).sum())
        return float(np.linalg.norm(last - anchors[0])) <= span + _TOLERANCE

    def tip_pose(self, joints: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Position (3,) of the tip, m, and its rotation (3, 3) from the tool straight down."""
        self._place(joints)
        return np.array(self._tip), self._tool.reshape(3, 3) @ DOWN

    def tip_height(self, joints: FloatArray) -> float:
        """Height of the tip, m."""
        self._place(joints)
        return float(self._tip[2])

    def tip_poses(self, path: FloatArray) -> tuple[FloatArray, FloatArray]:
        """As ``tip_pose``, (N, 3) and (N, 3, 3), for joint positions (N, dof)."""
        positions, tools = np.empty((len(path), 3)), np.empty((len(path), 9))
        for row, values in enumerate(path):
            self._place(values)
            positions[row], tools[row] = self._tip, self._tool
        return positions, tools.reshape(-1, 3, 3) @ DOWN

    def inertia_matrix(self, joints: FloatArray) -> FloatArray:
        """Joint-space inertia (dof, dof) at positions (dof,): kg m^2, or kg of a slide."""
        model, data = self._model, self._data
        self._place(joints)
        mujoco.mj_comPos(model, data)
        mujoco.mj_crb(model, data)
        inertia = np.zeros((self.dof, self.dof))
        mujoco.mj_fullM(model, data, inertia)
        return inertia

    def shift_tip(self, joints: FloatArray, twist: FloatArray) -> FloatArray:
        """Joint positions (dof,) after a small twist (6,) of the tip (m, then rad), to first order, within limits."""
        model, data, jacobian = self._model, self._data, self._jacobian
        self._place(joints)
        mujoco.mj_comPos(model, data)
        mujoco.mj_jacSite(model, data, jacobian[:3], jacobian[3:], self._site)
        square = jacobian @ jacobian.T + _DAMPING
        return np.clip(joints + jacobian.T @ np.linalg.solve(square, twist), self.low, self.high)

    def solve_ik(
        self, tip: FloatArray, tool: FloatArray, start: FloatArray, rest: FloatArray, iterations: int
    ) -> FloatArray | None:
        """Joint positions (dof,) within limits for a pose of the tip (position in m, rotation (3, 3)), or None.

        Damped least squares from ``start``; the null space draws the joints towards ``rest``. The z axis of the tip
        points out of the cup.
        """
        model, data, jacobian = self._model, self._data, self._jacobian
        joints = np.clip(start, self.low, self.high)
        wanted, present, turn, error, load = np.empty(4), np.empty(4), np.empty(4), np.empty(6), np.empty(6)
        mujoco.mju_mat2Quat(wanted, np.ascontiguousarray(tool).ravel())
        for _ in range(iterations):
            self._place(joints)
            error[:3] = tip - self._tip
            mujoco.mju_mat2Quat(present, self._tool)
            present[1:] *= -1
            mujoco.mju_mulQuat(turn, wanted, present)
            mujoco.mju_quat2Vel(error[3:], turn, 1.0)
            if float(np.abs(error).max()) < _TOLERANCE:
                return joints
            mujoco.mj_comPos(model, data)
            mujoco.mj_jacSite(model, data, jacobian[:3], jacobian[3:], self._site)
            homeward = _HOMEWARD * (rest - joints)
            square = jacobian @ jacobian.T + _DAMPING
            mujoco.mju_cholFactor(square, 0.0)
            mujoco.mju_cholSolve(load, square, error - jacobian @ homeward)
            change = homeward + jacobian.T @ load
            change *= min(1.0, _LONGEST / max(float(np.abs(change).max()), 1e-9))
            before, joints = joints, np.clip(joints + change, self.low, self.high)
            if float(np.abs(joints - before).max()) < _STALLED:  # no closer from this start
                return None
        return None

    def first_collision_along(self, path: FloatArray) -> Collision | None:
        """The collision at the first row of joint positions (N, dof) that has any."""
        model, data = self._model, self._data
        for row in path:
            self._place(row)
            mujoco.mj_collision(model, data)
            if data.ncon:
                return self._current_collisions()[0]
        return None

    def touching_body_pairs(self, joints: FloatArray) -> list[tuple[str, str]]:
        """Pairs of bodies in contact at joint positions (dof,)."""
        if self.first_collision_along(joints[None]) is None:
            return []
        return [(gap.first, gap.second) for gap in self._current_collisions()]

    def _current_collisions(self) -> list[Collision]:
        collisions: list[Collision] = []
        for pair, distance in zip(self._data.contact.geom, self._data.contact.dist, strict=True):
            first, second = sorted(int(self._model.geom_bodyid[geom]) for geom in pair)
            names = [str(self._model.body(body).name) for body in (first, second)]
            collisions.append(Collision(names[0], names[1], max(0.0, -float(distance))))
        return collisions


def build_arm_model_ignoring_home_contacts(add: Callable[[Any], None], home: FloatArray, hand: str) -> ArmModel:
    """The arm alone; contacts of its parts at ``home`` (dof,) are by design and do not count."""
    return ArmModel(add, ArmModel(add, hand=hand).touching_body_pairs(home), hand)
