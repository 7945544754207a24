"""What stands for an object without an asset: a textured mesh with colliders, or a primitive of its measured size."""

from dataclasses import dataclass

import numpy as np

from grs_agents.base import Vec3
from grs_agents.base.geometry.transforms import to_vec3
from grs_agents.library.shapes import Shape, shape_bounds
from grs_agents.perception.proxies.meshes import Faceted, box_mesh, join_meshes, revolved_mesh
from grs_agents.perception.shapes.colliders import Collider, Hull, fit_colliders, open_box_colliders, ring_colliders
from grs_agents.perception.shapes.observation import observe_object
from grs_agents.perception.shapes.texture import paint_mesh
from grs_agents.perception.shapes.types import ObjectShape, ObjectView, TexturedMesh
from grs_agents.perception.types import Array, Solid

WALL = 0.005  # how thick walls and floors of hollow primitives are, m
_PLAIN = 4  # a side of a picture of one colour, pixels


@dataclass(frozen=True)
class Proxy:
    """What stands for an object; in its frame, with the origin on the support."""

    mesh: TexturedMesh  # what is seen
    colliders: tuple[Collider, ...]  # what touches
    hollow: bool  # one can put something into it
    color: Vec3  # mean red, green, blue in 0..1

    @classmethod
    def from_shape(cls, shape: ObjectShape, color: Vec3, solid: Solid, hollow: bool) -> "Proxy":
        """A reconstructed shape with the colliders that fit it; ``solid`` and ``hollow`` as in `fit_colliders`."""
        return cls(shape.mesh, fit_colliders(shape, solid, hollow), shape.hollow or hollow, color)

    @property
    def bounds(self) -> tuple[Array, Array]:
        """The lowest and the highest corner, (3,) m, of its colliders."""
        ends = [
            (one.corners.min(axis=0), one.corners.max(axis=0)) if isinstance(one, Hull) else shape_bounds(one)
            for one in self.colliders
        ]
        return np.min([low for low, _ in ends], axis=0), np.max([high for _, high in ends], axis=0)

    @property
    def center(self) -> Vec3:
        """The middle between them, m."""
        low, high = self.bounds
        return to_vec3((low + high) / 2)


def primitive_proxy(
    solid: Solid, size: Vec3, color: Vec3, hollow: bool = False, view: ObjectView | None = None
) -> Proxy:
    """A box or a cylinder of a size (m), which one can put something into if ``hollow``.

    It shows what a view shows of it, else one colour (0..1). The diameter of a cylinder is the mean of its horizontal
    extents.
    """
    hollow = hollow and min(size) > 4 * WALL
    build = _build_cylinder_mesh_and_colliders if solid == "cylinder" else _build_box_mesh_and_colliders
    faceted, colliders = build(size, hollow)
    seen = None if view is None else observe_object(view)
    picture = np.full((_PLAIN, _PLAIN, 3), np.clip(np.multiply(color, 255).round(), 0, 255), np.uint8)
    plain = TexturedMesh(*faceted, np.zeros((len(faceted[0]), 2)), picture)
    return Proxy(plain if seen is None else paint_mesh(seen, *faceted), colliders, hollow, color)


def _build_box_mesh_and_colliders(size: Vec3, hollow: bool) -> tuple[Faceted, tuple[Collider, ...]]:
    x, y, z = size
    whole = Shape(kind="box", size=size, position=(0.0, 0.0, z / 2))
    walls = open_box_colliders(np.array((-x / 2, -y / 2, 0.0)), np.array((x / 2, y / 2, z))) if hollow else (whole,)
    return join_meshes([box_mesh(to_vec3(one.size), one.position) for one in walls]), tuple(walls)


def _build_cylinder_mesh_and_colliders(size: Vec3, hollow: bool) -> tuple[Faceted, tuple[Collider, ...]]:
    radius, height = (size[0] + size[1]) / 4, size[2]
    if hollow:
        inside = radius - WALL
        profile = [(0, 0), (radius, 0), (radius, height / 2), (radius, height), (inside, height), (inside, WALL)]
        walls = np.array([(inside, radius, WALL), (inside, radius, height)])
        return revolved_mesh([*profile, (0, WALL)]), ring_colliders(walls, np.zeros(2))
    rings = [(radius / 2, 0.0), (radius, 0.0), (radius, height / 3)]  # not too long for a texture
    upper = [(across, height - up) for across, up in reversed(rings)]
    whole = Shape(kind="cylinder", size=(radius, height), position=(0.0, 0.0, height / 2))
    return revolved_mesh([(0.0, 0.0), *rings, *upper, (0.0, height)]), (whole,)
