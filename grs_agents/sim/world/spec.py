"""Typed objects become a MuJoCo spec: colliders, the arm, the table top at z = 0, one suction weld a body. Ties are
joints of ropes and what is fixed to another object. A spec can be compiled, or written as MJCF."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final, Literal

import numpy as np

from grs_agents.base.mujoco_import import mujoco
from grs_agents.library.library import Library
from grs_agents.library.mesh_files import convex_mesh_volume
from grs_agents.library.mujoco_shapes import add_shape_geom
from grs_agents.library.shapes import ObjectModel, Shape, shape_volume
from grs_agents.sim.arms.arm import Arm
from grs_agents.sim.arms.arm_parts import ROBOT_CONTYPE, replace_cup_with_spatula
from grs_agents.sim.arms.registry import get_arm
from grs_agents.sim.instance.episode import SimulationError
from grs_agents.sim.instance.task_instance import (
    HEAVIEST,
    LEAST_FRICTION,
    LIGHTEST,
    MOST_FRICTION,
    InstanceObject,
    InstanceTie,
    TaskInstance,
)
from grs_agents.sim.world import templates
from grs_agents.sim.world.appearance import TABLE_CENTER, TABLE_SIDE, add_textures, set_light_and_table
from grs_agents.sim.world.colors import COLORS

LARGEST_BEAD: Final = 0.05
"""What is larger and tied at a point is no bead of a rope: the cup must seal on it as on any other thing, metres."""
_BEAD_ARMATURE: Final = 1e-5
_BEAD_DAMPING: Final = 6e-5
"""Of what is tied at a point: added to its inertia (kg m^2), and against its turning (N m s/rad)."""


def find_object_ids_in_point_ties(ties: Sequence[InstanceTie]) -> frozenset[int]:
    """Ids of what a point ties to another."""
    return frozenset(number for tie in ties if tie.kind == "point" for number in (tie.parent, tie.child))


def add_tie_constraints(spec: Any, ties: Sequence[InstanceTie], timestep: float) -> None:
    """One equality of two sites for each tie, between the bodies called ``object_<id>``."""
    for index, tie in enumerate(ties):
        names: list[str] = []
        for number, (position, (x, y, z, w)) in ((tie.parent, tie.parent_frame), (tie.child, tie.child_frame)):
            names.append(f"tie_{index}_{number}")
            spec.body(f"object_{number}").add_site(name=names[-1], pos=position, quat=(w, x, y, z))
        kind = mujoco.mjtEq.mjEQ_CONNECT if tie.kind == "point" else mujoco.mjtEq.mjEQ_WELD
        equality = spec.add_equality(
            name=f"tie_{index}", type=kind, objtype=mujoco.mjtObj.mjOBJ_SITE, name1=names[0], name2=names[1]
        )
        equality.solref = (2 * timestep, 1.0)
        if tie.kind == "point":
            _tune_bead_dynamics(spec, tie)


def _tune_bead_dynamics(spec: Any, tie: InstanceTie) -> None:
    """Small things on a joint are slow to turn: it keeps the joint steady, and balls from rolling off as marbles do."""
    for number in (tie.parent, tie.child):
        for joint in spec.body(f"object_{number}").joints:
            joint.armature, joint.damping = _BEAD_ARMATURE, np.full(3, _BEAD_DAMPING)
        for geom in spec.body(f"object_{number}").geoms:
            geom.condim = 3


TIMESTEP: Final = 0.004
_SLEEP_SPEED: Final = 0.003
"""What is slower (m/s) for ten time steps sleeps: at MuJoCo's 0.001 things that lean on one another in a heap never do,
rock by 0.1 degrees and cost five times the rest of the scene."""
Tool = Literal["suction", "spatula"]
_DENSITY: Final = 300.0
_CROWD: Final = 12
_SMALL_ARENA: Final = 8 << 20
"""Bytes for the contacts of so few bodies, instead of 17 MB: groceries use 0.4, and episodes are kept as states."""
_FEW_TIES: Final = 3
"""Of more loose bodies that are pushed, or more ties, an iterative solver takes care, faster and steadier."""
_ROLLING: Final = 0.002
"""Arm of a ball's rolling resistance (m), as of a rubber ball on wood: one of 4 cm rests on slopes up to 6 degrees."""
_GREY: Final = (0.7, 0.7, 0.7, 1.0)
LARGEST, SMALLEST = 2.0, 1e-4
"""Extents of a filled template, metres."""


@dataclass(frozen=True)
class WorldSpec:
    """A world before it is compiled: bodies ``object_<id>``, the arm's, welds ``suction_<id>``, ties ``tie_<n>``."""

    spec: Any  # ``mujoco.MjSpec``
    models: Mapping[int, ObjectModel]  # the shapes of each object, by its id
    free: tuple[int, ...]  # ids of what can move
    graspable: tuple[int, ...]  # ids of what has a suction weld
    arm: Arm
    ties: tuple[InstanceTie, ...]


def load_object_model(item: InstanceObject, library: Library) -> ObjectModel:
    """The shapes of an object or filled template; one too large, or too thin, is a ``SimulationError``."""
    if not item.fill:
        return library.load_object_model(item.asset)
    return templates.cached_template_result(
        library, "model", item.asset, item.fill, lambda: _load_filled_template(item, library)
    )


def _load_filled_template(item: InstanceObject, library: Library) -> ObjectModel:
    shapes = library.load_filled_template(item.asset, item.fill)
    solids = [shape.size for shape in shapes.colliders if shape.kind != "mesh"]
    thinnest = min([LARGEST, *(shapes.size if shapes.colliders else ()), *(side for size in solids for side in size)])
    if max(shapes.size) > LARGEST or thinnest < SMALLEST:
        size = " x ".join(f"{extent:.3g}" for extent in shapes.size)
        found = f"{item.asset} filled in is {size} m, its thinnest part {thinnest:.1e} m"
        raise SimulationError(found, f"give lengths that make it at most {LARGEST} m, each part at least {SMALLEST} m")
    return shapes


def is_movable(item: InstanceObject, shapes: ObjectModel) -> bool:
    """Whether the object can move: not fixed, and solid enough to touch anything."""
    return item.category != "fixed" and bool(shapes.colliders)


def fill_in_masses_and_frictions(instance: TaskInstance, library: Library) -> TaskInstance:
    """The instance with the mass and the friction that each object has in its world as numbers, whatever it said.

    Beyond what an instance may say it says None, and the asset's own holds.
    """
    stated: list[InstanceObject] = []
    for item in instance.objects:
        shapes, own = load_object_model(item, library), item.model_copy(update={"mass": None, "friction": None})
        volume = 0.0 if shapes.mass > 0 else sum(_collider_volume(shape, library) for shape in shapes.colliders)
        mass = _object_mass(own, shapes, volume)
        update = {
            "mass": mass if LIGHTEST <= mass <= HEAVIEST else None,
            "friction": shapes.friction if LEAST_FRICTION <= shapes.friction <= MOST_FRICTION else None,
        }
        stated.append(own.model_copy(update=update))
    return instance.model_copy(update={"objects": tuple(stated)})


def create_base_world_spec(timestep: float) -> Any:
    """An empty world with the options that were measured to be fast and steady, the table and a light."""
    spec = mujoco.MjSpec()
    spec.modelname = "grs"
    spec.compiler.degree = False
    option = spec.option
    option.timestep = timestep
    option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    option.cone = mujoco.mjtCone.mjCONE_ELLIPTIC
    option.impratio = 10.0
    option.jacobian = mujoco.mjtJacobian.mjJAC_DENSE
    option.enableflags |= int(mujoco.mjtEnableBit.mjENBL_SLEEP)
    option.sleep_tolerance = _SLEEP_SPEED
    spec.default.geom.solref = (2.5 * timestep, 1.0)
    spec.worldbody.add_light(pos=(0.3, -0.5, 2.0), dir=(0.0, 0.2, -1.0))
    spec.worldbody.add_geom(
        name="table",
        type=mujoco.mjtGeom.mjGEOM_BOX,
        size=(TABLE_SIDE / 2, TABLE_SIDE / 2, 0.05),
        pos=(*TABLE_CENTER, -0.05),
        rgba=(0.80, 0.72, 0.60, 1.0),
        contype=1,
        conaffinity=1,
        friction=(0.8, 0.01, 0.0005),
        condim=4,
    )
    return spec


def objects_to_spec(
    objects: Sequence[InstanceObject],
    library: Library,
    timestep: float = TIMESTEP,
    visuals: bool = False,
    ties: Sequence[InstanceTie] = (),
    tool: Tool = "suction",
    arm: Arm | None = None,
    background: str | None = None,
) -> WorldSpec:
    """The spec of a world whose objects all stand at the origin: ``build_world`` compiles it once for all their poses.

    ``visuals`` adds what is only seen (meshes, marks on the table); a spatula takes nothing up, so there are no suction
    welds beside it. Raises ``UnknownNameError`` for an asset that the library has not, ``SimulationError`` for a filled
    template that is too large or too thin.
    """
    spec = create_base_world_spec(timestep)
    arm = arm or get_arm()
    arm.add(spec)
    if tool == "spatula":
        replace_cup_with_spatula(spec)
    models = {item.id: load_object_model(item, library) for item in objects}
    free = tuple(item.id for item in objects if is_movable(item, models[item.id]))
    for item in objects:
        _add_object(spec, item, models[item.id], library, visuals)
    if background is not None:
        _add_background(spec, library.load_object_model(background), library, visuals)
    if len(free) <= _CROWD:
        spec.memory = _SMALL_ARENA
    graspable = free if tool == "suction" else ()
    if len(ties) > _FEW_TIES or len(free) - len(graspable) > _CROWD:
        _use_iterative_solver(spec)
    _add_suction_welds(spec, graspable, timestep)
    add_tie_constraints(spec, ties, timestep)
    return WorldSpec(spec, models, free, graspable, arm, tuple(ties))


def instance_to_spec(instance: TaskInstance, library: Library, visuals: bool = False) -> WorldSpec:
    """The spec of a task instance, its objects at their poses; with ``visuals`` it looks as the instance says, textures
    included. Errors as ``objects_to_spec``."""
    made = objects_to_spec(
        instance.objects,
        library,
        instance.timestep,
        visuals,
        instance.ties,
        "spatula" if instance.primitive == "push" else "suction",
        get_arm(instance.robot),
        instance.background,
    )
    made.spec.modelname = f"{instance.task}_{instance.seed}"
    for item in instance.objects:
        body, (position, (x, y, z, w)) = made.spec.body(f"object_{item.id}"), item.pose
        body.pos, body.quat = position, (w, x, y, z)
    if visuals:
        add_textures(made.spec, instance.objects, made.models, library)
        set_light_and_table(made.spec, instance.light, instance.table, library)
    return made


def _use_iterative_solver(spec: Any) -> None:
    """Options for piles and ropes: 50 grains in a heap cost 0.3 ms a step so, 2-3 ms with those for a few objects."""
    option = spec.option
    option.solver = mujoco.mjtSolver.mjSOL_CG
    option.jacobian = mujoco.mjtJacobian.mjJAC_SPARSE
    option.cone = mujoco.mjtCone.mjCONE_PYRAMIDAL
    option.impratio, option.tolerance, option.iterations = 1.0, 1e-6, 50
    for geom in spec.geoms:
        geom.condim = 3 if geom.condim == 4 else geom.condim


def _add_suction_welds(spec: Any, graspable: Sequence[int], timestep: float) -> None:
    """One weld to the cup, switched off, for each object that it may take."""
    for number in graspable:
        name = f"suction_{number}"
        objtype = mujoco.mjtObj.mjOBJ_BODY
        weld = spec.add_equality(
            name=name, type=mujoco.mjtEq.mjEQ_WELD, objtype=objtype, name1="cup", name2=f"object_{number}", active=False
        )
        weld.solref = (2 * timestep, 1.0)


def _add_object(spec: Any, item: InstanceObject, shapes: ObjectModel, library: Library, visuals: bool) -> None:
    name = f"object_{item.id}"
    body = spec.worldbody.add_body(name=name)
    if is_movable(item, shapes):
        body.add_freejoint(name=name)
    friction = shapes.friction if item.friction is None else item.friction
    geoms = _add_collider_geoms(spec, body, shapes, library, visuals, friction)
    volumes = [_collider_volume(shape, library) for shape in shapes.colliders]
    total = sum(volumes)
    mass = _object_mass(item, shapes, total)
    for geom, shape, volume in zip(geoms, shapes.colliders, volumes, strict=True):
        geom.mass = max(mass * volume / total, 1e-5)
        geom.rgba = (*(item.color or shape.color or _GREY)[:3], 1.0)  # a ray misses what is wholly transparent
        if shape.kind == "sphere":
            geom.condim, geom.friction = 6, (friction, 0.01, _ROLLING)
    for geom, shape in _add_visual_geoms(spec, body, shapes, library, visuals):
        geom.mass, geom.rgba = 0.0, item.color or shape.color or _asset_color_rgba(item, library)


def _object_mass(item: InstanceObject, shapes: ObjectModel, volume: float) -> float:
    """Kilograms: what the instance says, else the asset, else by its volume (m^3)."""
    return item.mass or (shapes.mass if shapes.mass > 0 else max(0.02, _DENSITY * volume))


def _add_background(spec: Any, shapes: ObjectModel, library: Library, visuals: bool) -> None:
    """One body that never moves; objects and the arm bump into its boxes."""
    body = spec.worldbody.add_body(name="background")
    _add_collider_geoms(spec, body, shapes, library, visuals, shapes.friction)
    for geom, shape in _add_visual_geoms(spec, body, shapes, library, visuals):
        geom.rgba = shape.color or _GREY
        if shape.kind == "mesh":
            # It is open, so it has no volume.
            spec.mesh(geom.meshname).inertia = mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL


def _add_collider_geoms(
    spec: Any, body: Any, shapes: ObjectModel, library: Library, visuals: bool, friction: float
) -> list[Any]:
    """Add what is touched; it is seen only where ``visuals`` are not."""
    geoms = [_add_geom(spec, body, one, library, f"{body.name}_{index}") for index, one in enumerate(shapes.colliders)]
    for geom in geoms:
        geom.contype, geom.conaffinity, geom.group = 1, 1 | ROBOT_CONTYPE, 3 if visuals else 0
        geom.condim, geom.friction = 4, (friction, 0.01, 0.0)
    return geoms


def _add_visual_geoms(
    spec: Any, body: Any, shapes: ObjectModel, library: Library, visuals: bool
) -> Iterator[tuple[Any, Shape]]:
    """Add what is only seen, if ``visuals`` are asked for: each geom with its shape."""
    for index, shape in enumerate(shapes.visuals if visuals else ()):
        geom = _add_geom(spec, body, shape, library, f"{body.name}_visual_{index}")
        geom.contype, geom.conaffinity, geom.group = 0, 0, 2
        yield geom, shape


def _asset_color_rgba(item: InstanceObject, library: Library) -> tuple[float, float, float, float]:
    """The library's word for an asset's colour, for meshes whose colour is in a texture."""
    name = library.asset(item.asset).color if item.asset in library else ""
    red, green, blue = COLORS.get(name, [0.7, 0.7, 0.7])
    return (red, green, blue, 1.0)


def _collider_volume(shape: Shape, library: Library) -> float:
    """Of a collider, m^3; the parts of an object share its mass in this proportion."""
    if shape.kind != "mesh":
        return shape_volume(shape)
    return max(
        float(abs(np.prod(shape.size))) * convex_mesh_volume(library.mesh_or_texture_path(shape.mesh or "")), 1e-12
    )


def _add_geom(spec: Any, body: Any, shape: Shape, library: Library, name: str) -> Any:
    return add_shape_geom(spec, body, shape, name, library.mesh_or_texture_path(shape.mesh) if shape.mesh else None)
