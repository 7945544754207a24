"""PyBullet's way of making bodies from plain shapes; each becomes an object from a template of the library."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from grs_agents.base import Vec3
from grs_agents.geometry import transforms
from grs_agents.sim.instance.episode import SimulationError, UnsupportedError
from grs_agents.sim.world import templates
from grs_agents.sim.world.tabletop import Tabletop

GEOM_SPHERE, GEOM_BOX, GEOM_CYLINDER, GEOM_MESH = 2, 3, 4, 5
_TEMPLATES: Final = {
    GEOM_SPHERE: "sphere/sphere-template.urdf",
    GEOM_BOX: "box/box-template.urdf",
    GEOM_CYLINDER: "cylinder/cylinder-template.urdf",
}
_MARK: Final = "zone/zone-template.urdf"


@dataclass(frozen=True)
class PlainShape:
    """A shape that a program described: its kind ``GEOM_*``, full extents (m), and colour."""

    kind: int
    size: Vec3
    color: tuple[float, ...] | None = None


_shapes: list[PlainShape] = []


def forget() -> None:
    """Forget every shape, as a new environment begins without any."""
    _shapes.clear()


def add_shape(kind: int, radius: float, half_extents: Sequence[float], length: float, color: Any = None) -> int:
    """Note a shape; returns its number.

    Raises:
        UnsupportedError: it is no box, sphere or cylinder.
    """
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
        PlainShape(kind, transforms.vec3(extents[kind]), None if color is None else tuple(map(float, color)))
    )
    return len(_shapes) - 1


def add_body(env: Tabletop, mass: float, collision: int, visual: int, position: Any, rotation: Any) -> int:
    """Add a body of one noted shape to an environment; returns its id.

    What has no mass cannot move; what has no collision shape is a mark on the table. The mass is the template's.

    Raises:
        SimulationError: there is no such shape.
    """
    for number in (collision, visual):
        if not -1 <= number < len(_shapes):
            raise SimulationError(
                f"p.createMultiBody: there is no shape {number}", "use what createCollisionShape returned"
            )
    if collision < 0 and visual < 0:
        raise SimulationError("p.createMultiBody: a body without any shape", "give a collision shape")
    shape, seen = _shapes[collision if collision >= 0 else visual], _shapes[visual if visual >= 0 else collision]
    template = _TEMPLATES[shape.kind] if collision >= 0 else _MARK
    urdf = templates.fill(env.library, template, {"DIM": shape.size})
    pose = ((0.0, 0.0, 0.0) if position is None else transforms.vec3(position), transforms.quat(rotation))
    category = "rigid" if mass > 0 and collision >= 0 else "fixed"
    return env.add_object(urdf, pose, category, color=None if seen.color is None else list(np.asarray(seen.color)))
