"""Mugs: hollow, with a handle."""

import math
from dataclasses import dataclass

import numpy as np

from evals.synthesis.colliders import box, cylinder, lifted, ring
from evals.synthesis.meshes import Mesh, loft, superellipse, tube
from grs_agents.base import Vec3
from grs_agents.library.shapes import Shape

_WALL = 0.0035


@dataclass(frozen=True)
class MugParts:
    """The parts of a mug, around the centre of its box; its handle points to +x. Lengths in m."""

    body: Mesh
    handle: Mesh
    colliders: tuple[Shape, ...]
    size: Vec3


def mug_parts(radius: float, height: float, reach: float) -> MugParts:
    """A mug of this radius and height (m) whose handle reaches ``reach`` m beyond its wall."""
    profile = (
        (radius - 0.003, 0.0),
        (radius, 0.004),
        (radius, height),
        (radius - _WALL, height),
        (radius - _WALL, 0.006),
        (radius - 0.006, 0.005),
    )
    body = loft(superellipse(2.0, 32), [(r, r, z) for r, z in profile])
    middle, half = round(0.505 * height, 3), round(0.284 * height, 3)
    angles = np.linspace(-0.5 * math.pi, 0.5 * math.pi, 13)
    arc = np.stack([radius - 0.003 + (reach - 0.002) * np.cos(angles), 0 * angles, middle + half * np.sin(angles)], 1)
    handle = tube(arc, 0.005, (0.0, 1.0, 0.0))
    shift: Vec3 = (-reach / 2, 0.0, -height / 2)
    colliders = (
        cylinder(radius, 0.006, (0, 0, 0.003)),
        *ring(radius, 0.004, 0.006, height),
        box((0.010, 0.010, 2 * half), (radius + reach - 0.005, 0, middle)),
        *(
            box((reach - 0.008, 0.010, 0.010), (radius + reach / 2 - 0.005, 0, middle + side * (half - 0.001)))
            for side in (1, -1)
        ),
    )
    size = (2 * radius + reach, 2 * radius, height)
    return MugParts(body.moved(shift), handle.moved(shift), lifted(colliders, shift), size)
