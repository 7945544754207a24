"""A few of PyBullet's calls and constants, on the most recent environment; ``from grs_agents.sim import p``.

A body that is made from plain shapes becomes an object from a template of the library.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final, Literal

from pydantic import ValidationError

from grs_agents.base import Quat, Vec3
from grs_agents.base.geometry import transforms
from grs_agents.sim.instance.episode import InvalidValueError, SimulationError, UnsupportedError
from grs_agents.sim.instance.faults import describe_first_error
from grs_agents.sim.instance.task_instance import InstanceTie
from grs_agents.sim.tabletop import TabletopSim, parse_pose
from grs_agents.sim.world import templates

GEOM_SPHERE, GEOM_BOX, GEOM_CYLINDER, GEOM_MESH = 2, 3, 4, 5
_TEMPLATES: Final = {
    GEOM_SPHERE: "sphere/sphere-template.urdf",
    GEOM_BOX: "box/box-template.urdf",
    GEOM_CYLINDER: "cylinder/cylinder-template.urdf",
}
_MARK: Final = "zone/zone-template.urdf"


@dataclass(frozen=True)
class PlainShape:
    """Shape described by a program: its kind ``GEOM_*``, full extents (m) and colour."""

    kind: int
    size: Vec3
    color: tuple[float, ...] | None = None


_shapes: list[PlainShape] = []


def register_shape(kind: int, radius: float, half_extents: Sequence[float], length: float, color: Any = None) -> int:
    """Register a box, sphere or cylinder; returns its number. Raises ``UnsupportedError`` for other shapes."""
    if kind not in _TEMPLATES:
        raise UnsupportedError(
            f"p: a shape of type {kind} is not there", "use p.GEOM_BOX, GEOM_SPHERE or GEOM_CYLINDER"
        )
    extents = {
        GEOM_SPHERE: (2 * radius,) * 3,
        GEOM_BOX: tuple(2 * float(half) for half in half_extents),
        GEOM_CYLINDER: (2 * radius, 2 * radius, length),
    }
    _shapes.append(
        PlainShape(kind, transforms.to_vec3(extents[kind]), None if color is None else tuple(map(float, color)))
    )
    return len(_shapes) - 1


JOINT_PRISMATIC, JOINT_FIXED, JOINT_POINT2POINT = 1, 4, 5
_JOINTS: Final[dict[int, Literal["point", "fixed"]]] = {JOINT_POINT2POINT: "point", JOINT_FIXED: "fixed"}
_GEOMS: Final = {"sphere": GEOM_SPHERE, "box": GEOM_BOX, "cylinder": GEOM_CYLINDER, "mesh": GEOM_MESH}

_current: list[TabletopSim] = []


def set_current_environment(env: TabletopSim) -> None:
    """Make ``env`` the environment that the calls below read; it begins without any shape."""
    _current[:] = [env]
    _shapes.clear()


def _current_environment() -> TabletopSim:
    if not _current:
        raise SimulationError("p.* was called before any Environment was made", "make an Environment first")
    return _current[-1]


def getBasePositionAndOrientation(bodyUniqueId: int, *_: Any, **__: Any) -> tuple[Vec3, Quat]:
    """Position (m) of an object's centre and its rotation (xyzw)."""
    return _current_environment().get_object_pose(bodyUniqueId)


def getAABB(bodyUniqueId: int, *_: Any, **__: Any) -> tuple[Vec3, Vec3]:
    """Lowest and highest corner of an object as it stands, metres."""
    prism = _current_environment().object_prism(bodyUniqueId)
    x0, y0, x1, y1 = prism.bounding_box_xy
    return (x0, y0, prism.low), (x1, y1, prism.high)


def changeVisualShape(objectUniqueId: int, linkIndex: int = -1, rgbaColor: Any = None, **_: Any) -> None:
    """Recolour an object."""
    del linkIndex
    if rgbaColor is not None:
        _current_environment().set_color(objectUniqueId, rgbaColor)


def getVisualShapeData(objectUniqueId: int, *_: Any, **__: Any) -> tuple[tuple[Any, ...], ...]:
    """``(id, link, GEOM_*, dimensions, mesh file, position, rotation, rgba)`` of each visual shape of an object.

    Dimensions (m): extents of a box, (length, radius, 0) of a cylinder, thrice a sphere's radius, scale of a mesh.
    """
    env = _current_environment()
    own = env.object_by_id(objectUniqueId).color
    entries: list[tuple[Any, ...]] = []
    for shape in env.object_model(objectUniqueId).visuals:
        dimensions = shape.size
        if shape.kind == "cylinder":
            dimensions = (shape.size[1], shape.size[0], 0.0)
        elif shape.kind == "sphere":
            dimensions = shape.size * 3
        color = own or shape.color or (1.0, 1.0, 1.0, 1.0)
        entry = (dimensions, (shape.mesh or "").encode(), shape.position, shape.quaternion, color)
        entries.append((objectUniqueId, -1, _GEOMS[shape.kind], *entry))
    return tuple(entries)


def resetBasePositionAndOrientation(bodyUniqueId: int, posObj: Any, ornObj: Any, *_: Any, **__: Any) -> None:
    """Teleport an object to a pose."""
    env = _current_environment()
    asset = env.object_by_id(bodyUniqueId).asset
    pose = parse_pose((posObj, ornObj), f"p.resetBasePositionAndOrientation of object {bodyUniqueId} ({asset})")
    env.set_object_pose(bodyUniqueId, pose)


def getNumBodies(*_: Any, **__: Any) -> int:
    """How many objects the task has."""
    return sum(item.role == "task" for item in _current_environment().objects)


def multiplyTransforms(
    positionA: Any, orientationA: Any, positionB: Any, orientationB: Any, *_: Any, **__: Any
) -> tuple[Vec3, Quat]:
    """Transform B, given in the frame of A, in the frame that A is given in."""
    return transforms.compose_poses((positionA, orientationA), (positionB, orientationB))


def invertTransform(position: Any, orientation: Any, *_: Any, **__: Any) -> tuple[Vec3, Quat]:
    """The inverse of a transform."""
    return transforms.invert_pose((position, orientation))


def createConstraint(
    parentBodyUniqueId: int,
    parentLinkIndex: int,
    childBodyUniqueId: int,
    childLinkIndex: int,
    jointType: int,
    jointAxis: Any,
    parentFramePosition: Any,
    childFramePosition: Any,
    parentFrameOrientation: Any = transforms.IDENTITY,
    childFrameOrientation: Any = transforms.IDENTITY,
    *_: Any,
    **__: Any,
) -> int:
    """Tie two objects together at a point of either's frame (m): a ball joint, or fixed; returns its number.

    Raises ``UnsupportedError`` for a joint of another kind, or to the world (a child of -1).
    """
    del parentLinkIndex, childLinkIndex, jointAxis
    if jointType not in _JOINTS or childBodyUniqueId < 0:
        raise UnsupportedError(
            f"p.createConstraint: joint type {jointType} between {parentBodyUniqueId} and {childBodyUniqueId}",
            "use p.JOINT_POINT2POINT or p.JOINT_FIXED between two objects; category='fixed' holds one in place",
        )
    call = f"p.createConstraint between objects {parentBodyUniqueId} and {childBodyUniqueId}"
    parent_frame = parse_pose((parentFramePosition, parentFrameOrientation), f"{call}, frame of the parent")
    child_frame = parse_pose((childFramePosition, childFrameOrientation), f"{call}, frame of the child")
    try:
        tie = InstanceTie(
            kind=_JOINTS[jointType],
            parent=parentBodyUniqueId,
            child=childBodyUniqueId,
            parent_frame=parent_frame,
            child_frame=child_frame,
        )
    except ValidationError as error:
        raise InvalidValueError(describe_first_error(error, call)) from error
    return _current_environment().tie_objects(tie)


def createCollisionShape(
    shapeType: int, radius: float = 0.5, halfExtents: Any = (1, 1, 1), height: float = 1.0, *_: Any, **__: Any
) -> int:
    """Describe a box, a sphere or a cylinder (m) for ``createMultiBody``; returns its number."""
    return register_shape(shapeType, radius, halfExtents, height)


def createVisualShape(
    shapeType: int,
    radius: float = 0.5,
    halfExtents: Any = (1, 1, 1),
    length: float = 1.0,
    fileName: str = "",
    meshScale: Any = None,
    planeNormal: Any = None,
    rgbaColor: Any = None,
    *_: Any,
    **__: Any,
) -> int:
    """As ``createCollisionShape``; only its colour shows on a body that has a collision shape too."""
    del fileName, meshScale, planeNormal
    return register_shape(shapeType, radius, halfExtents, length, rgbaColor)


def createMultiBody(
    baseMass: float = 0,
    baseCollisionShapeIndex: int = -1,
    baseVisualShapeIndex: int = -1,
    basePosition: Any = None,
    baseOrientation: Any = transforms.IDENTITY,
    *_: Any,
    **__: Any,
) -> int:
    """Add a body of a single shape, with its template's mass; returns its id.

    Without mass it is fixed, without a collision shape a mark.
    """
    env, collision, visual = _current_environment(), baseCollisionShapeIndex, baseVisualShapeIndex
    for number in (collision, visual):
        if not -1 <= number < len(_shapes):
            raise SimulationError(
                f"p.createMultiBody: there is no shape {number}", "use what createCollisionShape returned"
            )
    if collision < 0 and visual < 0:
        raise SimulationError("p.createMultiBody: a body without any shape", "give a collision shape")
    shape, seen = _shapes[collision if collision >= 0 else visual], _shapes[visual if visual >= 0 else collision]
    template = _TEMPLATES[shape.kind] if collision >= 0 else _MARK
    urdf = templates.fill_template(env.library, template, {"DIM": shape.size})
    position = (0.0, 0.0, 0.0) if basePosition is None else transforms.to_vec3(basePosition)
    category = "rigid" if baseMass > 0 and collision >= 0 else "fixed"
    color = None if seen.color is None else list(seen.color)
    return env.add_object(urdf, (position, transforms.to_unit_quaternion(baseOrientation)), category, color=color)


def changeDynamics(bodyUniqueId: int, *_: Any, **__: Any) -> None:
    """Accepted with a warning: masses and friction are the library's."""
    _current_environment().object_by_id(bodyUniqueId)
    _current_environment().record_warning("p.changeDynamics: masses and friction are the library's, it changes nothing")


def changeConstraint(userConstraintUniqueId: int, *_: Any, **__: Any) -> None:
    """Accepted: a tie is as strong as the physics allows."""
    del userConstraintUniqueId


def __getattr__(name: str) -> Any:
    if name.startswith("_"):
        raise AttributeError(name)
    known = ", ".join(sorted(known for known in globals() if known[0] in "gcimrs" and not known.startswith("_")))
    raise AttributeError(f"p.{name} is not there; there are {known}")


def getEulerFromQuaternion(quaternion: Quat) -> Vec3:
    """(x, y, z, w) to roll, pitch, yaw in radians."""
    return transforms.quatXYZW_to_eulerXYZ(quaternion)


def getQuaternionFromEuler(eulerAngles: Vec3) -> Quat:
    """Roll, pitch, yaw in radians to (x, y, z, w)."""
    return transforms.eulerXYZ_to_quatXYZW(eulerAngles)


def stepSimulation(*_: Any) -> None:
    """Simulate one time step."""
    _current_environment().step_simulation()
