"""MuJoCo specs of typed objects: colliders, the arm, the table top at z = 0, suction welds, ties between objects.

A spec can be compiled, or written as MJCF.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from grs_agents.base.mujoco_import import mujoco
from grs_agents.library.library import Library
from grs_agents.library.mesh_files import convex_mesh_volume
from grs_agents.library.mujoco_shapes import add_shape_geom
from grs_agents.library.shapes import ObjectModel, Shape, shape_volume
from grs_agents.sim.arms.arm import Arm
from grs_agents.sim.arms.registry import get_arm
from grs_agents.sim.hands.hand import ROBOT_CONTYPE, Tool
from grs_agents.sim.hands.registry import get_tool
from grs_agents.sim.hands.spatula import replace_cup_with_spatula
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
"""Largest bead of a rope, metres: on larger objects in point ties the cup must seal as on any other."""
_BEAD_ARMATURE: Final = 1e-5
_BEAD_DAMPING: Final = 6e-5
"""Armature (kg m^2) and rotational damping (N m s/rad) of objects in point ties: small bodies on a joint then stay
steady, and balls do not roll off like marbles."""


def find_object_ids_in_point_ties(ties: Sequence[InstanceTie]) -> frozenset[int]:
    """Ids of the objects in point ties."""
    return frozenset(number for tie in ties if tie.kind == "point" for number in (tie.parent, tie.child))


def add_tie_constraints(spec: Any, ties: Sequence[InstanceTie], timestep: float) -> None:
    """Add an equality of two sites for each tie, between the bodies ``object_<id>``."""
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
        for number in (tie.parent, tie.child) if tie.kind == "point" else ():
            for joint in spec.body(f"object_{number}").joints:
                joint.armature, joint.damping = _BEAD_ARMATURE, np.full(3, _BEAD_DAMPING)
            for geom in spec.body(f"object_{number}").geoms:
                geom.condim = 3


TIMESTEP: Final = 0.004
_SLEEP_SPEED: Final = 0.003
"""Speed below which a body sleeps after ten time steps, m/s: at MuJoCo's 0.001 bodies that lean on one another in a
heap never sleep, rock by 0.1 degrees and cost five times the rest of the scene."""
_DENSITY: Final = 300.0
"""Density of objects without a mass, kg/m^3."""
_CROWD: Final = 12
_SMALL_ARENA: Final = 8 << 20
"""Arena (bytes) for the contacts of up to ``_CROWD`` free bodies, instead of 17 MB: groceries use 0.4 MB, and episodes
are kept as states."""
_FEW_TIES: Final = 3
"""Most ties for the direct solver; more ties, or a crowd of pushed bodies, are faster and steadier iteratively."""
_IMPRATIO_OF_FINGERS: Final = 100.0
"""Ratio of frictional to normal impedance: with less what is held by friction alone creeps out of the pads."""
_ROLLING: Final = 0.002
"""Coefficient of rolling friction, metres, as of a rubber ball on wood: a 4 cm ball rests on slopes up to 6 degrees."""
_GREY: Final = (0.7, 0.7, 0.7, 1.0)
LARGEST, SMALLEST = 2.0, 1e-4
"""Largest and least extent of a filled template, metres."""


@dataclass(frozen=True)
class WorldSpec:
    """A world before it is compiled: bodies ``object_<id>`` and the arm's, welds ``suction_<id>``, ties ``tie_<n>``."""

    spec: Any  # ``mujoco.MjSpec``
    models: Mapping[int, ObjectModel]  # the shapes of each object, by its id
    free: tuple[int, ...]  # ids of the movable objects
    graspable: tuple[int, ...]  # ids of the objects with a suction weld
    arm: Arm
    ties: tuple[InstanceTie, ...]


def load_object_model(item: InstanceObject, library: Library) -> ObjectModel:
    """Shapes of an object or filled template; raises ``SimulationError`` for a template too large or too thin."""
    if not item.fill:
        return library.load_object_model(item.asset)

    def load_filled_template() -> ObjectModel:
        shapes = library.load_filled_template(item.asset, item.fill)
        sides = [side for shape in shapes.colliders if shape.kind != "mesh" for side in shape.size]
        thinnest = min([LARGEST, *(shapes.size if shapes.colliders else ()), *sides])
        if max(shapes.size) > LARGEST or thinnest < SMALLEST:
            size = " x ".join(f"{extent:.3g}" for extent in shapes.size)
            raise SimulationError(
                f"{item.asset} filled in is {size} m, its thinnest part {thinnest:.1e} m",
                f"give lengths that make it at most {LARGEST} m, each part at least {SMALLEST} m",
            )
        return shapes

    return templates.cached_template_result(library, "model", item.asset, item.fill, load_filled_template)


def is_movable(item: InstanceObject, shapes: ObjectModel) -> bool:
    """Whether an object can move: it is not fixed and has colliders."""
    return item.category != "fixed" and bool(shapes.colliders)


def fill_in_masses_and_frictions(instance: TaskInstance, library: Library) -> TaskInstance:
    """The instance with every object's simulated mass and friction as numbers, whatever it stated.

    A value beyond an instance's bounds becomes None, which means the asset's own.
    """
    stated: list[InstanceObject] = []
    for item in instance.objects:
        shapes, plain = load_object_model(item, library), item.model_copy(update={"mass": None, "friction": None})
        volume = 0.0 if shapes.mass > 0 else sum(_collider_volume(shape, library) for shape in shapes.colliders)
        mass = _object_mass(plain, shapes, volume)
        update = {
            "mass": mass if LIGHTEST <= mass <= HEAVIEST else None,
            "friction": shapes.friction if LEAST_FRICTION <= shapes.friction <= MOST_FRICTION else None,
        }
        stated.append(plain.model_copy(update=update))
    return instance.model_copy(update={"objects": tuple(stated)})


def create_base_world_spec(timestep: float) -> Any:
    """World with the table, a light, and solver options that were measured to be fast and steady."""
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
    """The spec of a world with all objects at the origin: ``build_world`` compiles it once for all their poses.

    ``visuals`` adds visual geoms (meshes, marks on the table); only for the cup there are suction welds. Raises
    ``UnknownNameError`` for an unknown asset, ``SimulationError`` for a filled template too large or too thin.
    """
    spec = create_base_world_spec(timestep)
    arm = arm or get_arm()
    arm.add(spec, visuals)
    if tool == "spatula":
        replace_cup_with_spatula(spec)
    models = {item.id: load_object_model(item, library) for item in objects}
    free = tuple(item.id for item in objects if is_movable(item, models[item.id]))
    for item in objects:
        _add_object(spec, item, models[item.id], library, visuals)
    if background is not None:  # a fixed body; objects and the arm bump into its boxes
        shapes, body = library.load_object_model(background), spec.worldbody.add_body(name="background")
        _add_collider_geoms(spec, body, shapes, library, visuals, shapes.friction)
        for geom, shape in _add_visual_geoms(spec, body, shapes, library, visuals):
            geom.rgba = shape.color or _GREY
            if shape.kind == "mesh":  # an open mesh has no volume
                spec.mesh(geom.meshname).inertia = mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL
    if len(free) <= _CROWD:
        spec.memory = _SMALL_ARENA
    graspable = free if tool == "suction" else ()
    if tool == "fingers":
        spec.option.impratio = _IMPRATIO_OF_FINGERS
    if len(ties) > _FEW_TIES or (tool == "spatula" and len(free) > _CROWD):
        # 50 grains in a heap then cost 0.3 ms a step, 2-3 ms with the options for a few objects.
        option = spec.option
        option.solver = mujoco.mjtSolver.mjSOL_CG
        option.jacobian = mujoco.mjtJacobian.mjJAC_SPARSE
        option.cone = mujoco.mjtCone.mjCONE_PYRAMIDAL
        option.impratio, option.tolerance, option.iterations = 1.0, 1e-6, 50
        for geom in spec.geoms:
            geom.condim = 3 if geom.condim == 4 else geom.condim
    for number in graspable:  # a weld to the cup, switched off
        weld = spec.add_equality(
            name=f"suction_{number}",
            type=mujoco.mjtEq.mjEQ_WELD,
            objtype=mujoco.mjtObj.mjOBJ_BODY,
            name1="cup",
            name2=f"object_{number}",
            active=False,
        )
        weld.solref = (2 * timestep, 1.0)
    add_tie_constraints(spec, ties, timestep)
    return WorldSpec(spec, models, free, graspable, arm, tuple(ties))


def instance_to_spec(instance: TaskInstance, library: Library, visuals: bool = False) -> WorldSpec:
    """The spec of a task instance, objects at their poses; ``visuals`` adds its textures, light and table top.

    Errors as ``objects_to_spec``.
    """
    made = objects_to_spec(
        instance.objects,
        library,
        instance.timestep,
        visuals,
        instance.ties,
        "spatula" if instance.primitive == "push" else get_tool(instance.hand),
        get_arm(instance.robot, instance.mounted_hand),
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
        geom.rgba = (*(item.color or shape.color or _GREY)[:3], 1.0)  # rays miss transparent geoms
        if shape.kind == "sphere":
            geom.condim, geom.friction = 6, (friction, 0.01, _ROLLING)
    for geom, shape in _add_visual_geoms(spec, body, shapes, library, visuals):
        color = item.color or shape.color
        if not color:  # as of meshes with their colour in a texture: the library's word for it
            word = library.asset(item.asset).color if item.asset in library else ""
            color = (*COLORS.get(word, _GREY[:3]), 1.0)
        geom.mass, geom.rgba = 0.0, color


def _object_mass(item: InstanceObject, shapes: ObjectModel, volume: float) -> float:
    """Mass of an object, kg: the instance's, else the asset's, else from its volume (m^3)."""
    return item.mass or (shapes.mass if shapes.mass > 0 else max(0.02, _DENSITY * volume))


def _add_collider_geoms(
    spec: Any, body: Any, shapes: ObjectModel, library: Library, visuals: bool, friction: float
) -> list[Any]:
    """Add the collision geoms; they are visible only without ``visuals``."""
    geoms = [
        _add_geom(spec, body, shape, library, f"{body.name}_{index}") for index, shape in enumerate(shapes.colliders)
    ]
    for geom in geoms:
        geom.contype, geom.conaffinity, geom.group = 1, 1 | ROBOT_CONTYPE, 3 if visuals else 0
        geom.condim, geom.friction = 4, (friction, 0.01, 0.0)
    return geoms


def _add_visual_geoms(
    spec: Any, body: Any, shapes: ObjectModel, library: Library, visuals: bool
) -> Iterator[tuple[Any, Shape]]:
    """Add the visual geoms, with ``visuals`` only; yields each with its shape."""
    for index, shape in enumerate(shapes.visuals if visuals else ()):
        geom = _add_geom(spec, body, shape, library, f"{body.name}_visual_{index}")
        geom.contype, geom.conaffinity, geom.group = 0, 0, 2
        yield geom, shape


def _collider_volume(shape: Shape, library: Library) -> float:
    """Volume of a collider, m^3; colliders share their object's mass in proportion to it."""
    if shape.kind != "mesh":
        return shape_volume(shape)
    return max(
        float(abs(np.prod(shape.size))) * convex_mesh_volume(library.mesh_or_texture_path(shape.mesh or "")), 1e-12
    )


def _add_geom(spec: Any, body: Any, shape: Shape, library: Library, name: str) -> Any:
    return add_shape_geom(spec, body, shape, name, library.mesh_or_texture_path(shape.mesh) if shape.mesh else None)
