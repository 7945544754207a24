"""Colliders from primitives: stacks, rings and boxes with walls."""

import math

from grs_agents.base import Vec3
from grs_agents.library.shapes import Rgba, Shape, quaternion_from_rpy


def box(size: Vec3, position: Vec3 = (0.0, 0.0, 0.0), yaw: float = 0.0, color: Rgba | None = None) -> Shape:
    """A box of full extents ``size`` (m)."""
    return Shape(kind="box", size=size, position=position, quaternion=quaternion_from_rpy(0, 0, yaw), color=color)


def cylinder(radius: float, length: float, position: Vec3 = (0.0, 0.0, 0.0), color: Rgba | None = None) -> Shape:
    """An upright cylinder (m)."""
    return Shape(kind="cylinder", size=(radius, length), position=position, color=color)


def stadium(x: float, y: float, low: float, high: float) -> tuple[Shape, ...]:
    """An upright solid of extents x, y with round ends, from z = low to high (m): an oval package."""
    radius, offset, length, z = min(x, y) / 2, abs(x - y) / 2, high - low, (low + high) / 2
    if offset < 1e-4:
        return (cylinder(radius, length, (0, 0, z)),)
    along = (1.0, 0.0) if x > y else (0.0, 1.0)
    ends = tuple(cylinder(radius, length, (sign * offset * along[0], sign * offset * along[1], z)) for sign in (-1, 1))
    if offset < 0.25 * radius:  # the dimple between the two cylinders is below a millimetre
        return ends
    return (*ends, box((2 * offset, y, length) if x > y else (x, 2 * offset, length), (0, 0, z)))


def ring(radius: float, wall: float, low: float, high: float, count: int = 12) -> tuple[Shape, ...]:
    """An upright ring of ``count`` boxes whose corners touch the circle of ``radius``, ``wall`` m thick."""
    half = math.pi / count
    width, middle = 2 * radius * math.sin(half), radius * math.cos(half) - wall / 2
    return tuple(
        box(
            (wall, width, high - low),
            (middle * math.cos(angle), middle * math.sin(angle), (low + high) / 2),
            angle,
        )
        for angle in ((2 * index + 1) * half for index in range(count))
    )


def open_box(size: Vec3, wall: float, color: Rgba | None = None) -> tuple[Shape, ...]:
    """Floor and four walls of a box without a lid, of outer extents ``size``, all ``wall`` m thick."""
    x, y, z = size
    return (
        box((x, y, wall), (0, 0, (wall - z) / 2), color=color),
        box((wall, y, z), ((x - wall) / 2, 0, 0), color=color),
        box((wall, y, z), ((wall - x) / 2, 0, 0), color=color),
        box((x, wall, z), (0, (y - wall) / 2, 0), color=color),
        box((x, wall, z), (0, (wall - y) / 2, 0), color=color),
    )


def lifted(shapes: tuple[Shape, ...], offset: Vec3) -> tuple[Shape, ...]:
    """The shapes moved by ``offset`` m."""
    return tuple(
        shape.model_copy(update={"position": tuple(p + d for p, d in zip(shape.position, offset, strict=True))})
        for shape in shapes
    )
