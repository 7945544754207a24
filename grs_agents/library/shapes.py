"""Shapes of an object: primitives and meshes in the object's own frame."""

import math
from collections.abc import Iterable
from typing import Literal

import numpy as np
import numpy.typing as npt

from grs_agents.base import Frozen, Quat, Vec3
from grs_agents.base.geometry import transforms

Rgba = tuple[float, float, float, float]
ShapeKind = Literal["box", "cylinder", "sphere", "mesh"]
Points = npt.NDArray[np.float64]
Placement = tuple[Vec3, Quat]
"""A position in m and a rotation, xyzw."""
IDENTITY_PLACEMENT: Placement = ((0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0))


class Shape(Frozen):
    """A primitive or mesh."""

    kind: ShapeKind
    # full extents of a box, (radius, length along z) of a cylinder, (radius,) of a sphere, m; scale of a mesh
    size: tuple[float, ...]
    position: Vec3 = (0.0, 0.0, 0.0)  # centre of the shape in the object frame, m
    quaternion: Quat = (0.0, 0.0, 0.0, 1.0)  # rotation from the shape's frame to the object frame, xyzw
    color: Rgba | None = None  # red, green, blue, alpha in 0..1, or None if unspecified
    mesh: str | None = None  # library-relative name of the mesh file; only of meshes
    corners: tuple[Vec3, ...] = ()  # of the convex hull of a mesh that collides, in the file's own units and frame
    texture: str | None = None  # library-relative name of a PNG


class ObjectModel(Frozen):
    """A rigid object as its URDF describes it."""

    visuals: tuple[Shape, ...]  # visual geometry
    colliders: tuple[Shape, ...]  # collision geometry, meshes as their convex hulls; empty for marks on the table
    mass: float  # kg; 0 if the URDF gives no inertia (an object that never moves)
    friction: float  # coefficient of sliding friction
    bounds: tuple[Vec3, Vec3]  # lowest and highest corner (m) of the colliders, else of the visuals

    @property
    def size(self) -> Vec3:
        """Extents of ``bounds`` along x, y, z in m."""
        low, high = self.bounds
        return (high[0] - low[0], high[1] - low[1], high[2] - low[2])


matrix_from_quaternion = transforms.quaternion_to_matrix


def transform_shape(shape: Shape, placement: Placement) -> Shape:
    """The shape of a frame that is placed by ``placement``, in the frame around."""
    if placement == IDENTITY_PLACEMENT:
        return shape
    position, quaternion = transforms.compose_poses(placement, (shape.position, shape.quaternion))
    return shape.model_copy(update={"position": position, "quaternion": quaternion})


def looks_unchanged_by_rotation(model: ObjectModel, turn: Quat) -> bool:
    """True if a rotation by ``turn`` (in quarters) about an object's origin is invisible.

    A mesh or a picture on it is taken to look otherwise.
    """
    if any(shape.mesh or shape.texture for shape in model.visuals):
        return False
    turned = [transform_shape(shape, ((0.0, 0.0, 0.0), turn)) for shape in model.visuals]
    return sorted(map(_shape_appearance_key, model.visuals)) == sorted(map(_shape_appearance_key, turned))


def _shape_appearance_key(shape: Shape) -> tuple[object, ...]:
    """Kind, colour and bounds (1e-5 m) of a shape that is not a mesh."""
    room = [round(1e5 * float(value)) for corner in shape_bounds(shape) for value in corner]
    return (shape.kind, shape.color or (), *room)


def quaternion_from_rpy(roll: float, pitch: float, yaw: float) -> Quat:
    """The xyzw quaternion of URDF's fixed-axis roll, pitch, yaw (rad): Rz(yaw) Ry(pitch) Rx(roll)."""
    cr, sr = float(np.cos(roll / 2)), float(np.sin(roll / 2))
    cp, sp = float(np.cos(pitch / 2)), float(np.sin(pitch / 2))
    cy, sy = float(np.cos(yaw / 2)), float(np.sin(yaw / 2))
    x, y = sr * cp * cy - cr * sp * sy, cr * sp * cy + sr * cp * sy
    return (x, y, cr * cp * sy - sr * sp * cy, cr * cp * cy + sr * sp * sy)


def rpy_from_quaternion(quaternion: Quat) -> Vec3:
    """URDF's roll, pitch, yaw (rad) of an xyzw quaternion; the inverse of `quaternion_from_rpy`."""
    matrix = matrix_from_quaternion(quaternion)
    pitch = float(np.arcsin(np.clip(-matrix[2, 0], -1.0, 1.0)))
    if abs(matrix[2, 0]) > 1 - 1e-9:  # gimbal lock: only yaw -+ roll is defined, so roll is taken as 0
        return (0.0, pitch, float(np.arctan2(-matrix[0, 1], matrix[1, 1])))
    roll = float(np.arctan2(matrix[2, 1], matrix[2, 2]))
    return (roll, pitch, float(np.arctan2(matrix[1, 0], matrix[0, 0])))


def shape_bounds(shape: Shape, vertices: Points | None = None) -> tuple[Points, Points]:
    """Lowest and highest corner (m, object frame) of a shape; a mesh needs its unscaled ``vertices`` (N, 3)."""
    rotation, position = matrix_from_quaternion(shape.quaternion), np.asarray(shape.position, dtype=np.float64)
    if shape.kind == "mesh":
        if vertices is None:
            raise ValueError(f"the vertices of mesh {shape.mesh} are needed for its bounds")
        points = vertices * np.asarray(shape.size) @ rotation.T + position
        return points.min(axis=0), points.max(axis=0)
    if shape.kind == "box":
        reach = np.abs(rotation) @ (np.asarray(shape.size) / 2)
    elif shape.kind == "sphere":
        reach = np.full(3, shape.size[0])
    else:
        axis = rotation[:, 2]
        radius, length = shape.size
        reach = np.abs(axis) * length / 2 + radius * np.sqrt(np.clip(1 - axis**2, 0, 1))
    return position - reach, position + reach


def shape_volume(shape: Shape) -> float:
    """m^3 of a box, cylinder or sphere."""
    if shape.kind == "box":
        return math.prod(shape.size)
    radius = shape.size[0]
    return math.pi * radius**2 * shape.size[1] if shape.kind == "cylinder" else 4 / 3 * math.pi * radius**3


def merge_bounds(bounds: Iterable[tuple[Points, Points]]) -> tuple[Vec3, Vec3]:
    """The bounds around several bounds."""
    lows, highs = zip(*bounds, strict=True)
    low, high = np.min(lows, axis=0), np.max(highs, axis=0)
    return (float(low[0]), float(low[1]), float(low[2])), (float(high[0]), float(high[1]), float(high[2]))
