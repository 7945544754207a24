"""The arm in the picture: joints at which it touches nothing, and its triangles there."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt
import trimesh

from grs_agents.base.geometry.transforms import FloatArray
from grs_agents.base.mujoco_import import mujoco
from grs_agents.library.library import Library
from grs_agents.library.posed_meshes import Triangles, compute_smooth_normals
from grs_agents.library.shapes import matrix_from_quaternion, quaternion_from_rpy
from grs_agents.sim.arms.arm import Arm
from grs_agents.sim.instance.task_instance import InstanceObject
from grs_agents.sim.rendering.stage import Props, Stage
from grs_agents.sim.world.compilation import build_world, reset_world_to_poses

_TIPS = ((0.25, -0.35, 0.06), (0.70, 0.35, 0.50))
"""Box of the tip positions (m, robot frame)."""
_TILT = 0.9
"""Largest tilt of the tool from straight down, rad."""
_ATTEMPTS = 60
_SECTIONS = 24
"""Corners of a round part's cross-section."""


def free_postures(
    arm: Arm, items: Sequence[InstanceObject], library: Library, count: int, rng: np.random.Generator
) -> list[FloatArray]:
    """Up to ``count`` random joint positions (dof,) without collision of the arm with objects, table or itself.

    Args:
        arm: with its base at the origin of the robot frame.
        items: the objects, at their poses.
        library: of their assets.
        count: largest number of positions.
        rng: source of the tip's positions and the tool's tilts.
    """
    world = build_world(items, library, arm=arm)
    reset_world_to_poses(world, items)
    robot = world.owner_of_geom < 0
    robot[world.model.geom("table").id] = False
    postures: list[FloatArray] = []
    for _ in range(_ATTEMPTS):
        roll, pitch = (float(angle) for angle in rng.uniform(-_TILT, _TILT, 2))
        turn = matrix_from_quaternion(quaternion_from_rpy(roll, pitch, float(rng.uniform(-np.pi, np.pi))))
        joints = arm.solve_ik_for_poses(rng.uniform(*_TIPS)[None], turn[None])[0]
        if not np.isfinite(joints).all() or arm.find_collision_at_joints(joints) is not None:
            continue
        world.data.qpos[: arm.dof] = joints
        mujoco.mj_kinematics(world.model, world.data)
        mujoco.mj_collision(world.model, world.data)
        if not np.logical_xor.reduce(robot[world.data.contact.geom], axis=1).any():
            postures.append(joints)
        if len(postures) == count:
            break
    return postures


def robot_triangles(arm: Arm, joints: FloatArray, owner: int) -> Triangles:
    """The arm's visuals at joint positions (dof,), as triangles of ``owner`` in the robot frame."""
    stage = Stage(Props((), arm=arm, dressed=False), Library())
    stage.set_joint_positions(joints)
    stage.update()
    model, data = stage.model, stage.data
    shown = [number for number in range(model.ngeom) if model.geom_bodyid[number] > 0 and model.geom_rgba[number, 3]]
    parts = [
        _geom_corners(model, number) @ data.geom_xmat[number].reshape(3, 3).T + data.geom_xpos[number]
        for number in shown
    ]
    counts = [len(part) for part in parts]
    corners = np.concatenate(parts)
    return Triangles(
        corners=corners,
        normals=np.concatenate([compute_smooth_normals(part) for part in parts]),
        uvs=np.zeros((len(corners), 3, 2)),
        colors=np.repeat(np.array(model.geom_rgba[shown, :3], np.float64), counts, axis=0),
        texture=np.full(len(corners), -1),
        owner=np.full(len(corners), owner),
        textures=(),
    )


def _geom_corners(model: Any, number: int) -> npt.NDArray[np.float64]:
    """(T, 3, 3) corners of a geom's triangles in its own frame, m."""
    kinds, size = mujoco.mjtGeom, np.array(model.geom_size[number], np.float64)
    kind = kinds(int(model.geom_type[number]))
    if kind == kinds.mjGEOM_MESH:
        mesh = int(model.geom_dataid[number])
        start, first = int(model.mesh_vertadr[mesh]), int(model.mesh_faceadr[mesh])
        points = np.array(model.mesh_vert[start : start + int(model.mesh_vertnum[mesh])], np.float64)
        return points[np.array(model.mesh_face[first : first + int(model.mesh_facenum[mesh])])]
    shapes = {
        kinds.mjGEOM_BOX: lambda: trimesh.creation.box(2 * size),
        kinds.mjGEOM_SPHERE: lambda: trimesh.creation.icosphere(3, size[0]),
        kinds.mjGEOM_CYLINDER: lambda: trimesh.creation.cylinder(size[0], 2 * size[1], sections=_SECTIONS),
        kinds.mjGEOM_CAPSULE: lambda: trimesh.creation.capsule(2 * size[1], size[0], count=(_SECTIONS, _SECTIONS)),
    }
    solid = shapes[kind]()
    return np.asarray(solid.vertices, np.float64)[np.asarray(solid.faces)]
