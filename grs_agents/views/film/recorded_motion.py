"""Playback of a rollout's recorded motion on a stage."""

from typing import Any

import numpy as np
import numpy.typing as npt

from grs_agents.base.mujoco_import import mujoco
from grs_agents.sim.rendering.stage import Stage
from grs_agents.views.common.rollout_motion import Motion

FloatArray = npt.NDArray[np.float64]


def show_recorded_frame(stage: Stage, motion: Motion, frame: int, joints: FloatArray) -> None:
    """Pose everything as in ``frame``; ``joints`` (N, nq) come from ``recover_joint_positions``."""
    for index, name in enumerate(motion.names):
        kind, _, number = name.rpartition("_")
        if kind == "object" and int(number) in stage.object_ids:
            stage.set_object_pose(int(number), motion.positions[frame, index], motion.quaternions[frame, index])
    stage.set_joint_positions(joints[frame])
    stage.update()


def recover_joint_positions(model: Any, motion: Motion) -> FloatArray:
    """Returns: joint positions (N, nq) of the arm, from each link's rotation or translation relative to its parent
    link."""
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    rows = {name: index for index, name in enumerate(motion.names)}
    positions = np.tile(np.asarray(data.qpos), (len(motion.times), 1))
    for joint in range(model.njnt):
        body = int(model.jnt_bodyid[joint])
        name, parent = str(model.body(body).name), int(model.body_parentid[body])
        if name not in rows:
            continue
        parent_name = str(model.body(parent).name)
        if parent_name in rows:
            parent_quats = motion.quaternions[:, rows[parent_name]].astype(np.float64)[:, [3, 0, 1, 2]]
            parent_positions = motion.positions[:, rows[parent_name]].astype(np.float64)
        else:
            parent_quats = np.tile(np.asarray(data.xquat[parent]), (len(motion.times), 1))
            parent_positions = np.tile(np.asarray(data.xpos[parent]), (len(motion.times), 1))
        quats = motion.quaternions[:, rows[name]].astype(np.float64)[:, [3, 0, 1, 2]]
        rest_quats = _quaternion_product(parent_quats, np.asarray(model.body_quat[body])[None])
        axis, address = np.asarray(model.jnt_axis[joint]), int(model.jnt_qposadr[joint])
        if int(model.jnt_type[joint]) == int(mujoco.mjtJoint.mjJNT_HINGE):
            turned = _quaternion_product(rest_quats * (1, -1, -1, -1), quats)
            angle = 2 * np.arctan2(turned[:, 1:] @ axis, turned[:, 0])
            positions[:, address] = (angle + np.pi) % (2 * np.pi) - np.pi + model.qpos0[address]
        else:
            offset = _rotate_vector(parent_quats, np.asarray(model.body_pos[body]))
            shift = motion.positions[:, rows[name]] - parent_positions - offset
            axes = _rotate_vector(rest_quats, axis)
            positions[:, address] = np.einsum("ni,ni->n", shift, axes) + model.qpos0[address]
    return positions


def _quaternion_product(first: FloatArray, second: FloatArray) -> FloatArray:
    """Hamilton product of quaternions (N, 4), wxyz."""
    w, v, s, u = first[:, :1], first[:, 1:], second[:, :1], second[:, 1:]
    return np.concatenate([w * s - (v * u).sum(axis=1, keepdims=True), w * u + s * v + np.cross(v, u)], axis=1)


def _rotate_vector(turns: FloatArray, vector: FloatArray) -> FloatArray:
    """``vector`` (3,) rotated by each quaternion (N, 4), wxyz."""
    pure = np.concatenate([np.zeros(1), vector])[None]
    return _quaternion_product(_quaternion_product(turns, pure), turns * (1, -1, -1, -1))[:, 1:]
