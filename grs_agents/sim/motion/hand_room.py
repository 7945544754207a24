"""Room for a hand with fingers: what it would touch at a pose, without moving the world's own state."""

import copy
from typing import Any, Final

import numpy as np

from grs_agents.base.geometry.transforms import FloatArray
from grs_agents.base.mujoco_import import mujoco
from grs_agents.sim.hands.hand import ROBOT_CONTYPE
from grs_agents.sim.world.physics import Physics

MARGIN: Final = 0.003
"""Clearance that the hand keeps from everything, metres."""


class HandRoom:
    """The world at a moment with objects at rest, in which the hand flies, or the whole arm is set to joint positions.

    Objects meet the robot alone.

    Attributes:
        memory: facts about this moment, for those who ask again.
    """

    def __init__(self, physics: Physics) -> None:
        world = physics.world
        assert world.fingers is not None, "the hand has no fingers"
        self._world, self._index = world, world.fingers
        self._model: Any = copy.copy(physics.model)
        self._data: Any = mujoco.MjData(self._model)
        model = self._model
        self._hand = world.hand_body
        robot = model.geom_contype == ROBOT_CONTYPE
        solid = (model.geom_contype != 0) & ~robot
        model.geom_contype[solid], model.geom_conaffinity[solid] = 0, ROBOT_CONTYPE
        self._arm_geoms = robot & (model.geom_bodyid < self._hand)
        model.geom_margin[robot & ~self._arm_geoms] = MARGIN
        model.body_margin[self._hand : self._hand + 3] = MARGIN
        self._place = np.array(model.body_pos[self._hand]), np.array(model.body_quat[self._hand])
        self._parent = int(model.body_parentid[self._hand])
        self._home = world.arm.home_joints
        self._owner = world.owner_of_geom
        self._robot = robot
        self._length = world.arm.hand.length
        self.memory: dict[tuple[int, bool], Any] = {}
        self._seen = np.zeros(0)
        self.look(physics)

    def look(self, physics: Physics) -> None:
        """Take over the present poses of the objects."""
        seen = np.concatenate([physics.data.qpos, physics.commanded_joint_positions])
        if not np.array_equal(seen, self._seen):
            self._seen, self.memory = seen, {}
        self._data.qpos[:] = physics.data.qpos
        self._free = self._world.first_free
        self._flying: bool | None = None

    def touched_by_hand(self, tip: FloatArray, hand: FloatArray, width: float, spare: int = -1) -> list[int]:
        """Ids of the objects, -1 for the table, that the hand alone would touch.

        Args:
            tip: (3,) position of the tip, metres.
            hand: (3, 3) axes of the hand; z points out of it.
            width: between the pads, metres.
            spare: id of an object that does not count.
        """
        model, data = self._model, self._data
        if self._flying is not True:
            model.geom_contype[self._arm_geoms] = 0
            data.qpos[: self._world.arm.dof] = self._home
            mujoco.mj_kinematics(model, data)
            self._flying = True
            self._base = np.array(data.xpos[self._parent]), np.array(data.xmat[self._parent]).reshape(3, 3)
        base, axes = self._base
        model.body_pos[self._hand] = axes.T @ (tip - self._length * hand[:, 2] - base)
        mujoco.mju_mat2Quat(model.body_quat[self._hand], np.ascontiguousarray(axes.T @ hand).ravel())
        return self._touched(width, spare)

    def touched_by_arm(self, joints: FloatArray, width: float, spare: int = -1) -> list[int]:
        """As ``touched_by_hand``, by the whole robot at joint positions (dof,)."""
        model, data = self._model, self._data
        if self._flying is not False:
            model.geom_contype[self._arm_geoms] = ROBOT_CONTYPE
            model.body_pos[self._hand], model.body_quat[self._hand] = self._place
            self._flying = False
        data.qpos[: self._world.arm.dof] = joints
        return self._touched(width, spare)

    def _touched(self, width: float, spare: int) -> list[int]:
        model, data = self._model, self._data
        data.qpos[self._index.positions] = width / 2
        mujoco.mj_kinematics(model, data)
        mujoco.mj_collision(model, data)
        if data.ncon == 0:
            return []
        pairs = data.contact.geom
        owners: list[int] = self._owner[pairs[~self._robot[pairs]]].tolist()
        return [owner for owner in owners if owner != spare]
