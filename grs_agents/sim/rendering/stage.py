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
from grs_agents.sim.arms.arm_parts import replace_cup_with_spatula
from grs_agents.sim.arms.registry import get_arm
from grs_agents.sim.instance.task_instance import InstanceLight, InstanceObject, InstanceTable, TaskInstance
from grs_agents.sim.world.appearance import set_light_and_table
from grs_agents.sim.world.colors import COLORS
from grs_agents.sim.world.physics import Physics
from grs_agents.sim.world.spec import TIMESTEP, create_base_world_spec, load_object_model

_GREY: Final = (0.7, 0.7, 0.7, 1.0)
LARGEST_PICTURE: Final = 2048
"""Pixels of a side that an off-screen picture may have."""
_SHADOWS: Final = 1024
"""Pixels of a side of the map of shadows; MuJoCo's own 4096 take 0.1 s a frame without a graphics card."""
TABLE_GROUP, ARM_GROUP, THINGS_GROUP = 0, 1, 2
"""Groups of geoms; things are the objects and the background."""
SKY: Final = ((0.93, 0.95, 0.97), (0.75, 0.79, 0.84))
"""Its colours above and below."""


@dataclass(frozen=True)
class Props:
    """What a stage shows."""

    objects: Sequence[InstanceObject]
    arm: Arm | None = None  # the robot; None leaves it out
    push: bool = False  # the robot has a spatula
    dressed: bool = True  # the robot as it looks; False shows what of it touches things
    background: str | None = None  # library name of what stands fixed around it
    textures: bool = True  # False paints what has a texture in its one colour
    samples: int = 4  # taken of each pixel of an off-screen picture; 0 is quick and leaves edges rough
    shadows: bool = True
    flash: float = 0.4  # light that comes from the camera, 0..1
    glossy: bool = True  # things reflect the lights
    light: InstanceLight = field(default_factory=InstanceLight)
    table: InstanceTable = field(default_factory=InstanceTable)


def scene_props_from_instance(instance: TaskInstance, arm: Arm | None = None) -> Props:
    """What shows a task instance, with its own robot unless another is given."""
    return Props(
        instance.objects,
        arm or get_arm(instance.robot),
        instance.primitive == "push",
        background=instance.background,
        light=instance.light,
        table=instance.table,
    )


class Stage:
    """A model that is only looked at: its objects have no weight and stand where they are put, at first at their poses.

    Attributes:
        model, data: MuJoCo's, in the state last shown.
        object_ids: of what it shows.
        owners: (ngeom,) object id of each geom, -1 for the table, the robot and the background.
        library: where its assets are.
        textured: the shapes that show a texture, by geom id.

    Raises ``InputError`` for meshes and textures that MuJoCo does not take.
    """

    def __init__(self, props: Props, library: Library) -> None:
        spec = create_base_world_spec(TIMESTEP)
        spec.visual.global_.offwidth = spec.visual.global_.offheight = LARGEST_PICTURE
        spec.visual.quality.offsamples, spec.visual.quality.shadowsize = props.samples, _SHADOWS if props.shadows else 0
        _apply_lighting_and_table(spec, props, library)
        _add_sky(spec)
        if props.arm is not None:
            add_robot(spec, props.arm, props.push, props.dressed)
        textured: dict[str, Shape] = {}
        for item in props.objects:
            textured |= _add_object(spec, item, library, props.textures)
        if props.background is not None:
            _add_background(spec, props.background, library)
        try:
            self.model: Any = spec.compile()
        except ValueError as error:  # meshes and textures of a run's own that MuJoCo does not take
            raise InputError(f"MuJoCo cannot show the scene: {error}", "mend the assets that it names") from error
        self.library = library
        self.textured = {int(self.model.geom(name).id): shape for name, shape in textured.items()}
        self._index_bodies(props)
        self.data: Any = mujoco.MjData(self.model)
        for item in props.objects:
            self.set_object_pose(item.id, np.array(item.pose[0]), np.array(item.pose[1]))
        if props.arm is not None:
            self.data.qpos[: self._dof] = props.arm.home_joints
        self.update()

    def _index_bodies(self, props: Props) -> None:
        bodies = {int(self.model.body(f"object_{item.id}").id): item.id for item in props.objects}
        self._mocap = {number: int(self.model.body_mocapid[body]) for body, number in bodies.items()}
        self.object_ids = frozenset(self._mocap)
        self._dof = 0 if props.arm is None else props.arm.dof
        owners = [bodies.get(int(body), -1) for body in self.model.geom_bodyid]
        self.owners: npt.NDArray[np.int32] = np.array(owners, np.int32)

    def set_object_pose(self, number: int, position: npt.NDArray[Any], quaternion: npt.NDArray[Any]) -> None:
        """Put an object at a position (3,), m, and a rotation (4,), xyzw; it is seen there after ``update``."""
        self.data.mocap_pos[self._mocap[number]] = position
        self.data.mocap_quat[self._mocap[number]] = quaternion[[3, 0, 1, 2]]

    def set_joint_positions(self, joints: FloatArray) -> None:
        """Bring the arm to joint positions (dof,); it is seen there after ``update``."""
        self.data.qpos[: self._dof] = joints

    def copy_state(self, physics: Physics) -> None:
        """Bring everything where it is in a world that was made of the same objects."""
        data, world, state = self.data, physics.world, physics.data
        for number, row in self._mocap.items():
            start = world.addresses.get(number)
            if start is not None:
                data.mocap_pos[row] = state.qpos[start : start + 3]
                data.mocap_quat[row] = state.qpos[start + 3 : start + 7]
            else:
                body = world.bodies[number]
                data.mocap_pos[row], data.mocap_quat[row] = world.model.body_pos[body], world.model.body_quat[body]
        data.qpos[: self._dof] = state.qpos[: self._dof]
        self.update()

    @property
    def tip_pose(self) -> FloatArray:
        """T_robot_tip (4, 4) of the tool, m; z points out of it."""
        tip = self.data.site("tip")
        return pose_matrix(np.array(tip.xmat).reshape(3, 3), np.array(tip.xpos))

    def update(self) -> None:
        """Work out where everything is seen."""
        mujoco.mj_kinematics(self.model, self.data)
        mujoco.mj_comPos(self.model, self.data)
        mujoco.mj_camlight(self.model, self.data)


def add_robot(spec: Any, arm: Arm, push: bool, dressed: bool = True) -> None:
    """Add a robot to what is drawn, with the spatula to ``push``; ``dressed`` as it looks, else what of it touches."""
    arm.add(spec)
    if push:
        replace_cup_with_spatula(spec)
    if dressed:
        set_arm_visuals(spec, arm.looks)


def _apply_lighting_and_table(spec: Any, props: Props, library: Library) -> None:
    table = props.table if props.textures else props.table.model_copy(update={"texture": None})
    set_light_and_table(spec, props.light, table, library)
    spec.visual.headlight.diffuse = (props.flash,) * 3
    if not props.glossy:
        spec.visual.headlight.specular = spec.lights[0].specular = (0.0, 0.0, 0.0)


def _add_sky(spec: Any) -> None:
    kind, gradient = mujoco.mjtTexture.mjTEXTURE_SKYBOX, mujoco.mjtBuiltin.mjBUILTIN_GRADIENT
    spec.add_texture(name="sky", type=kind, builtin=gradient, rgb1=SKY[0], rgb2=SKY[1], width=64, height=64)


def _shape_color(item: InstanceObject, shape: Shape, library: Library, textures: bool) -> tuple[float, ...] | None:
    """What to paint a shape with; None leaves it to its texture."""
    if shape.texture and textures and not item.color:
        return None
    if color := item.color or shape.color:
        return color
    name = library.asset(item.asset).color if item.asset in library else ""
    return (*COLORS.get(name, _GREY[:3]), 1.0)


def _add_object(spec: Any, item: InstanceObject, library: Library, textures: bool) -> dict[str, Shape]:
    """The shapes that show their texture, by the names of their geoms."""
    body = spec.worldbody.add_body(name=f"object_{item.id}", mocap=True)
    shapes, textured = load_object_model(item, library), dict[str, Shape]()
    for index, shape in enumerate(shapes.visuals or shapes.colliders):
        color, name = _shape_color(item, shape, library, textures), f"object_{item.id}_{index}"
        _add_shape(spec, body, shape, library, name, color)
        if color is None:
            textured[name] = shape
    return textured


def _add_background(spec: Any, name: str, library: Library) -> None:
    body = spec.worldbody.add_body(name="background")
    for index, shape in enumerate(library.load_object_model(name).visuals):
        geom = _add_shape(spec, body, shape, library, f"background_{index}", shape.color or _GREY)
        if shape.kind == "mesh":  # it is open, so it has no volume
            spec.mesh(geom.meshname).inertia = mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL


def _add_shape(spec: Any, body: Any, shape: Shape, library: Library, name: str, color: tuple[float, ...] | None) -> Any:
    geom = add_shape_geom(spec, body, shape, name, library.mesh_or_texture_path(shape.mesh) if shape.mesh else None)
    geom.contype, geom.conaffinity, geom.mass, geom.group = 0, 0, 0.0, THINGS_GROUP
    if color is not None:
        geom.rgba = color
    else:
        add_texture_file(spec, name, library.mesh_or_texture_path(shape.texture or ""))
        spec.add_material(name=name).textures[int(mujoco.mjtTextureRole.mjTEXROLE_RGB)] = name
        geom.material = name
    return geom
