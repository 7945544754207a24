"""A scene that is only looked at: the arm, the table and the objects with their textures, moved from outside."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from grs_agents.base.errors import InputError
from grs_agents.base.geometry.transforms import FloatArray, pose_matrix
from grs_agents.base.mujoco_import import mujoco
from grs_agents.library.library import Library
from grs_agents.library.mujoco_shapes import add_shape_geom, add_texture_file
from grs_agents.library.shapes import Shape
from grs_agents.sim.arms.arm import Arm
from grs_agents.sim.arms.arm_looks import set_arm_visuals
from grs_agents.sim.arms.registry import get_arm
from grs_agents.sim.hands.spatula import replace_cup_with_spatula
from grs_agents.sim.instance.task_instance import InstanceLight, InstanceObject, InstanceTable, TaskInstance
from grs_agents.sim.world.appearance import set_light_and_table
from grs_agents.sim.world.colors import COLORS
from grs_agents.sim.world.physics import Physics
from grs_agents.sim.world.spec import TIMESTEP, create_base_world_spec, load_object_model

_GREY: Final = (0.7, 0.7, 0.7, 1.0)
LARGEST_PICTURE: Final = 2048
"""Largest side of an off-screen image, px."""
_SHADOWS: Final = 1024
"""Side of the shadow map, px; MuJoCo's default 4096 takes 0.1 s a frame without a graphics card."""
TABLE_GROUP, ARM_GROUP, THINGS_GROUP = 0, 1, 2
"""Geom groups; objects and background share the last."""
SKY: Final = ((0.93, 0.95, 0.97), (0.75, 0.79, 0.84))
"""Colours of the sky, top and bottom."""


@dataclass(frozen=True)
class Props:
    """Contents and rendering options of a stage."""

    objects: Sequence[InstanceObject]
    arm: Arm | None = None  # the robot; None leaves it out
    push: bool = False  # the robot has a spatula
    dressed: bool = True  # the robot with its looks; False shows its collision geometry
    background: str | None = None  # library name of the fixed surroundings of the robot
    textures: bool = True  # False paints textured shapes in their single colour
    samples: int = 4  # per pixel of an off-screen image; 0 is fast, with aliased edges
    shadows: bool = True
    flash: float = 0.4  # headlight intensity, 0..1
    glossy: bool = True  # specular reflection
    light: InstanceLight = field(default_factory=InstanceLight)
    table: InstanceTable = field(default_factory=InstanceTable)


def scene_props_from_instance(instance: TaskInstance, arm: Arm | None = None) -> Props:
    """Props of a task instance, with its own robot unless another is given."""
    return Props(
        instance.objects,
        arm or get_arm(instance.robot, instance.mounted_hand),
        instance.primitive == "push",
        background=instance.background,
        light=instance.light,
        table=instance.table,
    )


class Stage:
    """A kinematic MuJoCo model for rendering; its objects are mocap bodies that stay at their poses until moved.

    Attributes:
        model, data: MuJoCo's, in the state last shown.
        object_ids: ids of the objects.
        owners: (ngeom,) object id of each geom, -1 for the table, the robot and the background.
        library: source of the assets.
        textured: textured shapes by geom id.

    Raises ``InputError`` for meshes and textures that MuJoCo refuses.
    """

    def __init__(self, props: Props, library: Library) -> None:
        spec = create_base_world_spec(TIMESTEP)
        spec.visual.global_.offwidth = spec.visual.global_.offheight = LARGEST_PICTURE
        spec.visual.quality.offsamples, spec.visual.quality.shadowsize = props.samples, _SHADOWS if props.shadows else 0
        table = props.table if props.textures else props.table.model_copy(update={"texture": None})
        set_light_and_table(spec, props.light, table, library)
        spec.visual.headlight.diffuse = (props.flash,) * 3
        if not props.glossy:
            spec.visual.headlight.specular = spec.lights[0].specular = (0.0, 0.0, 0.0)
        kind, gradient = mujoco.mjtTexture.mjTEXTURE_SKYBOX, mujoco.mjtBuiltin.mjBUILTIN_GRADIENT
        spec.add_texture(name="sky", type=kind, builtin=gradient, rgb1=SKY[0], rgb2=SKY[1], width=64, height=64)
        if props.arm is not None:
            add_robot(spec, props.arm, props.push, props.dressed)
        textured: dict[str, Shape] = {}
        for item in props.objects:
            body = spec.worldbody.add_body(name=f"object_{item.id}", mocap=True)
            shapes = load_object_model(item, library)
            for index, shape in enumerate(shapes.visuals or shapes.colliders):
                name, color = f"object_{item.id}_{index}", item.color or shape.color
                if shape.texture and props.textures and not item.color:
                    textured[name], color = shape, None
                elif color is None:
                    asset_color = library.asset(item.asset).color if item.asset in library else ""
                    color = (*COLORS.get(asset_color, _GREY[:3]), 1.0)
                _add_shape(spec, body, shape, library, name, color)
        if props.background is not None:
            body = spec.worldbody.add_body(name="background")
            for index, shape in enumerate(library.load_object_model(props.background).visuals):
                geom = _add_shape(spec, body, shape, library, f"background_{index}", shape.color or _GREY)
                if shape.kind == "mesh":  # open surface, without a volume
                    spec.mesh(geom.meshname).inertia = mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL
        try:
            self.model: Any = spec.compile()
        except ValueError as error:  # meshes and textures of the run itself that MuJoCo refuses
            raise InputError(f"MuJoCo cannot show the scene: {error}", "mend the assets that it names") from error
        self.library = library
        self.textured = {int(self.model.geom(name).id): shape for name, shape in textured.items()}
        bodies = {int(self.model.body(f"object_{item.id}").id): item.id for item in props.objects}
        self._mocap = {number: int(self.model.body_mocapid[body]) for body, number in bodies.items()}
        self.object_ids = frozenset(self._mocap)
        owners = [bodies.get(int(body), -1) for body in self.model.geom_bodyid]
        self.owners: npt.NDArray[np.int32] = np.array(owners, np.int32)
        self.data: Any = mujoco.MjData(self.model)
        for item in props.objects:
            self.set_object_pose(item.id, np.array(item.pose[0]), np.array(item.pose[1]))
        if props.arm is not None:
            self.data.qpos[: props.arm.dof] = props.arm.home_joints
            self.data.qpos[props.arm.dof :] = self.model.jnt_range[props.arm.dof :, 1]  # fingers wide open
        self.update()

    def set_object_pose(self, number: int, position: npt.NDArray[Any], quaternion: npt.NDArray[Any]) -> None:
        """Set an object's position (3,), m, and rotation (4,), xyzw; shown after ``update``."""
        self.data.mocap_pos[self._mocap[number]] = position
        self.data.mocap_quat[self._mocap[number]] = quaternion[[3, 0, 1, 2]]

    def set_joint_positions(self, joints: FloatArray) -> None:
        """Set the joint positions (dof,) of the arm, perhaps with those of its fingers; shown after ``update``."""
        self.data.qpos[: len(joints)] = joints

    def copy_state(self, physics: Physics) -> None:
        """Copy the poses of a simulated world with the same objects."""
        data, world, state = self.data, physics.world, physics.data
        for number, row in self._mocap.items():
            start = world.addresses.get(number)
            if start is not None:
                data.mocap_pos[row] = state.qpos[start : start + 3]
                data.mocap_quat[row] = state.qpos[start + 3 : start + 7]
            else:
                body = world.bodies[number]
                data.mocap_pos[row], data.mocap_quat[row] = world.model.body_pos[body], world.model.body_quat[body]
        data.qpos[:] = state.qpos[: self.model.nq]
        self.update()

    @property
    def tip_pose(self) -> FloatArray:
        """T_robot_tip (4, 4) of the tool, m; z points out of it."""
        tip = self.data.site("tip")
        return pose_matrix(np.array(tip.xmat).reshape(3, 3), np.array(tip.xpos))

    def update(self) -> None:
        """Compute the world poses of bodies, cameras and lights."""
        mujoco.mj_kinematics(self.model, self.data)
        mujoco.mj_comPos(self.model, self.data)
        mujoco.mj_camlight(self.model, self.data)


def add_robot(spec: Any, arm: Arm, push: bool, dressed: bool = True) -> None:
    """Add a robot to a rendered spec, with the spatula to ``push``; ``dressed`` in its looks, else as it collides."""
    arm.add(spec, dressed)
    if push:
        replace_cup_with_spatula(spec)
    if dressed:
        set_arm_visuals(spec, arm.looks, arm.hand.body)


def _add_shape(spec: Any, body: Any, shape: Shape, library: Library, name: str, color: tuple[float, ...] | None) -> Any:
    """Add a visual geom; without a ``color`` it shows its texture."""
    geom = add_shape_geom(spec, body, shape, name, library.mesh_or_texture_path(shape.mesh) if shape.mesh else None)
    geom.contype, geom.conaffinity, geom.mass, geom.group = 0, 0, 0.0, THINGS_GROUP
    if color is not None:
        geom.rgba = color
    else:
        add_texture_file(spec, name, library.mesh_or_texture_path(shape.texture or ""))
        spec.add_material(name=name).textures[int(mujoco.mjtTextureRole.mjTEXROLE_RGB)] = name
        geom.material = name
    return geom
