"""A rollout as MuJoCo shows it: the arm, the table and the objects with their textures, moved by the recording.
Where there is no graphics library, the picture is made of rays."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from grs_agents.errors import InputError
from grs_agents.library import Library, Shape, add_shape_geom
from grs_agents.mujoco_import import mujoco
from grs_agents.sim.arms import Arm, replace_cup_with_spatula
from grs_agents.sim.instance import InstanceObject, TaskInstance
from grs_agents.sim.world import COLORS, compilation
from grs_agents.views.common import Motion

FloatArray = npt.NDArray[np.float64]
_GREY = (0.7, 0.7, 0.7, 1.0)
_LARGEST_PICTURE = 2048
"""Pixels of a side that an off-screen picture may have."""
_SHADOWS = 1024
"""Pixels of a side of the map of shadows; MuJoCo's own 4096 take 0.1 s a frame without a graphics card."""


@dataclass(frozen=True)
class Props:
    """What a stage shows."""

    objects: Sequence[InstanceObject]
    arm: Arm | None = None  # the robot; None leaves it out
    push: bool = False  # the robot has a spatula
    background: str | None = None  # library name of what stands fixed around it
    textures: bool = True  # False paints textured things in their one named colour, for pictures made of rays
    samples: int = 4  # taken of each pixel of an off-screen picture; 0 is quick and leaves edges rough


def scene_props_from_instance(instance: TaskInstance, arm: Arm) -> Props:
    """What shows a task instance."""
    return Props(instance.objects, arm, instance.primitive == "push", instance.background)


class Stage:
    """A model that is only looked at: its objects have no weight and stand where they are put.
    Attributes: model, data: MuJoCo's, in the state last shown."""

    def __init__(self, props: Props, library: Library) -> None:
        spec = compilation.create_base_world_spec(compilation.TIMESTEP)
        spec.visual.global_.offwidth = spec.visual.global_.offheight = _LARGEST_PICTURE
        spec.visual.quality.offsamples, spec.visual.quality.shadowsize = props.samples, _SHADOWS
        spec.visual.headlight.ambient = (0.35, 0.35, 0.35)
        _add_sky(spec)
        if props.arm is not None:
            props.arm.add(spec)
            if props.push:
                replace_cup_with_spatula(spec)
        for item in props.objects:
            _add_object(spec, item, library, props.textures)
        if props.background is not None:
            _add_background(spec, props.background, library)
        try:
            self.model: Any = spec.compile()
        except ValueError as error:  # meshes and textures of a run's own that MuJoCo does not take
            raise InputError(f"MuJoCo cannot show the scene: {error}", "mend the assets that it names") from error
        self.data: Any = mujoco.MjData(self.model)
        names = [f"object_{item.id}" for item in props.objects]
        self._mocap = {name: int(self.model.body(name).mocapid[0]) for name in names}
        for name, item in zip(names, props.objects, strict=True):
            self._set_object_pose(name, np.array(item.pose[0]), np.array(item.pose[1]))
        if props.arm is not None:
            self.data.qpos[: props.arm.dof] = props.arm.home_joints
        mujoco.mj_forward(self.model, self.data)

    def set_frame(self, motion: Motion, frame: int, joints: FloatArray) -> None:
        """Bring everything where it was in ``frame``; ``joints`` are those of :func:`recover_joint_positions`."""
        for index, name in enumerate(motion.names):
            if name in self._mocap:
                self._set_object_pose(name, motion.positions[frame, index], motion.quaternions[frame, index])
        self.data.qpos[:] = joints[frame]
        mujoco.mj_forward(self.model, self.data)

    def _set_object_pose(self, name: str, position: npt.NDArray[Any], quaternion: npt.NDArray[Any]) -> None:
        self.data.mocap_pos[self._mocap[name]] = position
        self.data.mocap_quat[self._mocap[name]] = quaternion[[3, 0, 1, 2]]


def recover_joint_positions(model: Any, motion: Motion) -> FloatArray:
    """Joint positions (N, nq) of the arm, from the turn or shift of each link in the frame of the one before."""
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    rows = {name: index for index, name in enumerate(motion.names)}
    positions = np.tile(np.asarray(data.qpos), (len(motion.times), 1))
    for joint in range(model.njnt):
        body = int(model.jnt_bodyid[joint])
        name, parent = str(model.body(body).name), int(model.body_parentid[body])
        if name not in rows:
            continue
        before = str(model.body(parent).name)
        if before in rows:
            turns = motion.quaternions[:, rows[before]].astype(np.float64)[:, [3, 0, 1, 2]]
            places = motion.positions[:, rows[before]].astype(np.float64)
        else:
            turns = np.tile(np.asarray(data.xquat[parent]), (len(motion.times), 1))
            places = np.tile(np.asarray(data.xpos[parent]), (len(motion.times), 1))
        own = motion.quaternions[:, rows[name]].astype(np.float64)[:, [3, 0, 1, 2]]
        start = _quaternion_product(turns, np.asarray(model.body_quat[body])[None])
        axis, address = np.asarray(model.jnt_axis[joint]), int(model.jnt_qposadr[joint])
        if int(model.jnt_type[joint]) == int(mujoco.mjtJoint.mjJNT_HINGE):
            turned = _quaternion_product(start * (1, -1, -1, -1), own)
            angle = 2 * np.arctan2(turned[:, 1:] @ axis, turned[:, 0])
            positions[:, address] = (angle + np.pi) % (2 * np.pi) - np.pi + model.qpos0[address]
        else:
            shift = motion.positions[:, rows[name]] - places - _rotate_points(turns, np.asarray(model.body_pos[body]))
            positions[:, address] = np.einsum("ni,ni->n", shift, _rotate_points(start, axis)) + model.qpos0[address]
    return positions


def _quaternion_product(first: FloatArray, second: FloatArray) -> FloatArray:
    """The product of quaternions (N, 4), wxyz."""
    w, v, s, u = first[:, :1], first[:, 1:], second[:, :1], second[:, 1:]
    return np.concatenate([w * s - (v * u).sum(axis=1, keepdims=True), w * u + s * v + np.cross(v, u)], axis=1)


def _rotate_points(turns: FloatArray, vector: FloatArray) -> FloatArray:
    """``vector`` (3,) turned by each quaternion (N, 4), wxyz."""
    pure = np.concatenate([np.zeros(1), vector])[None]
    return _quaternion_product(_quaternion_product(turns, pure), turns * (1, -1, -1, -1))[:, 1:]


def _shape_color(item: InstanceObject, shape: Shape, library: Library, textures: bool) -> tuple[float, ...] | None:
    """What to paint a shape with; None leaves it to its texture."""
    if item.color or not shape.texture:
        return item.color or shape.color or _GREY
    if textures:
        return None
    name = library.asset(item.asset).color if item.asset in library else ""
    return (*COLORS.get(name, _GREY[:3]), 1.0)


def _add_sky(spec: Any) -> None:
    kind, gradient = mujoco.mjtTexture.mjTEXTURE_SKYBOX, mujoco.mjtBuiltin.mjBUILTIN_GRADIENT
    above, below = (0.93, 0.95, 0.97), (0.75, 0.79, 0.84)
    spec.add_texture(name="sky", type=kind, builtin=gradient, rgb1=above, rgb2=below, width=64, height=64)


def _add_object(spec: Any, item: InstanceObject, library: Library, textures: bool) -> None:
    body = spec.worldbody.add_body(name=f"object_{item.id}", mocap=True)
    shapes = compilation.load_object_model(item, library)
    for index, shape in enumerate(shapes.visuals or shapes.colliders):
        color = _shape_color(item, shape, library, textures)
        _add_shape(spec, body, shape, library, f"object_{item.id}_{index}", color)


def _add_background(spec: Any, name: str, library: Library) -> None:
    body = spec.worldbody.add_body(name="background")
    for index, shape in enumerate(library.load_object_model(name).visuals):
        geom = _add_shape(spec, body, shape, library, f"background_{index}", shape.color or _GREY)
        if shape.kind == "mesh":  # it is open, so it has no volume
            spec.mesh(geom.meshname).inertia = mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL


def _add_shape(spec: Any, body: Any, shape: Shape, library: Library, name: str, color: tuple[float, ...] | None) -> Any:
    geom = add_shape_geom(spec, body, shape, name, library.mesh_or_texture_path(shape.mesh) if shape.mesh else None)
    geom.contype, geom.conaffinity, geom.mass, geom.group = 0, 0, 0.0, 2
    if color is not None:
        geom.rgba = color
    else:
        file = str(library.mesh_or_texture_path(shape.texture or ""))
        spec.add_texture(name=name, type=mujoco.mjtTexture.mjTEXTURE_2D, file=file)
        spec.add_material(name=name).textures[int(mujoco.mjtTextureRole.mjTEXROLE_RGB)] = name
        geom.material = name
    return geom


_LIGHT = np.array([0.2, -0.3, 0.93])
_GROUPS = np.array([1, 1, 1, 0, 0, 0], dtype=np.uint8)
_SKY = 0.90


def raycast_image(
    model: Any, data: Any, eye: npt.NDArray[np.float64], directions: npt.NDArray[np.float64]
) -> npt.NDArray[np.uint8]:
    """(H, W, 3) colours that rays (H, W, 3) from ``eye`` (m) meet, lit from above."""
    shape, count = directions.shape[:2], directions.shape[0] * directions.shape[1]
    geom, distance, normal = np.full(count, -1, np.int32), np.empty(count), np.empty(3 * count)
    flat = np.ascontiguousarray(directions).ravel()
    mujoco.mj_multiRay(model, data, eye, flat, _GROUPS, 1, -1, geom, distance, normal, count, 1e10)
    hit = geom >= 0
    shade = np.clip(np.abs(normal.reshape(-1, 3) @ _LIGHT), 0.3, 1.0)
    color = np.where(hit[:, None], np.asarray(model.geom_rgba)[geom, :3] * shade[:, None], _SKY)
    return (color * 255).astype(np.uint8).reshape(*shape, 3)
