"""Ropes: beads in a row, each tied to the next at a point, laid on the table in a gentle curve."""

from itertools import pairwise
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from grs_agents.base import Pose
from grs_agents.geometry import transforms
from grs_agents.sim.instance.episode import NoFreeSpaceError, SimulationError
from grs_agents.sim.instance.instance import InstanceTie
from grs_agents.sim.motion import placement
from grs_agents.sim.world import templates
from grs_agents.sim.world.footprints import turn
from grs_agents.sim.world.tabletop import Tabletop

FloatArray = npt.NDArray[np.float64]
_BEAD: Final = "sphere/sphere_rope.urdf"
_BEAD_RADIUS: Final = 0.005
_BENDS: Final = (1.0, 1.0, 1.6, 2.4, 3.2, 4.2)
"""How far a rope may turn from end to end, radians: gentle first, more where there is little room."""
_TRIES: Final = 12


def make(
    env: Tabletop, bounds: FloatArray, corners: Any, radius: float, n_parts: int, color_name: str
) -> tuple[list[tuple[int, tuple[float, None]]], list[Pose], FloatArray]:
    """Add a rope; see ``Task.make_ropes``.

    Raises:
        SimulationError: fewer than two beads, or beads that would not fit side by side.
        NoFreeSpaceError: there is no room for it.
    """
    first, last = (_point(corner) for corner in corners)
    step = (last - first) / max(n_parts, 1)
    spacing = float(np.linalg.norm(step))
    if n_parts < 2 or spacing < 0.002:
        raise SimulationError(
            f"make_ropes: {n_parts} beads over {spacing * n_parts:.3f} m", "give two corners apart, and more beads"
        )
    points = _lay(env, bounds, n_parts, spacing, min(radius, spacing / 2))
    numbers = _beads(env, points, min(radius, spacing / 2), color_name)
    for parent, child in pairwise(numbers):
        env.tie(
            InstanceTie(
                kind="point",
                parent=parent,
                child=child,
                parent_frame=((spacing, 0.0, 0.0), transforms.IDENTITY),
                child_frame=((0.0, 0.0, 0.0), transforms.IDENTITY),
            )
        )
    targets = [(transforms.vec3(first + (index + 0.5) * step), transforms.IDENTITY) for index in range(n_parts)]
    matches = np.clip(np.eye(n_parts) + np.eye(n_parts)[::-1], 0, 1)
    return [(number, (0.0, None)) for number in numbers], targets, matches


def _point(corner: Any) -> FloatArray:
    point = np.asarray(corner[0] if np.ndim(corner[0]) else corner, dtype=np.float64)
    if point.shape != (3,) or not np.isfinite(point).all():
        raise SimulationError(f"make_ropes: corner {corner!r} is no point", "give (x, y, z) in metres")
    return point


def _beads(env: Tabletop, points: FloatArray, radius: float, color_name: str) -> list[int]:
    """Add beads at points (N, 2), each with its x axis towards the next."""
    urdf, color = _BEAD, None if color_name == "red" else color_name
    if abs(radius - _BEAD_RADIUS) > 1e-6:
        urdf, color = templates.fill(env.library, "sphere/sphere-template.urdf", {"DIM": (2 * radius,) * 3}), color_name
    steps = np.diff(points, axis=0, append=2 * points[-1:] - points[-2:-1])
    numbers: list[int] = []
    for index, ((x, y), (dx, dy)) in enumerate(zip(points, steps, strict=True)):
        rotation = transforms.eulerXYZ_to_quatXYZW((0.0, 0.0, float(np.arctan2(dy, dx))))
        shade = "white" if index in (0, len(points) - 1) else color
        numbers.append(env.add_object(urdf, ((float(x), float(y), radius), rotation), color=shade))
    return numbers


def _lay(env: Tabletop, bounds: FloatArray, count: int, spacing: float, radius: float) -> FloatArray:
    """Points (count, 2) of a curve with equal steps that lies free on the table, within reach."""
    standing = [env.outline(item.id) for item in env.objects]
    for bend in _BENDS:
        for _ in range(_TRIES):
            curve = _curve(count, spacing, bend * float(env.rng.uniform(0.5, 1.0) * env.rng.choice([-1.0, 1.0])))
            size = (*(np.ptp(curve, axis=0) + 2 * radius), 2 * radius)
            pose = placement.random_pose(size, bounds, standing, env.rng, env.arm)
            if pose is None:
                break
            points = curve @ turn(transforms.yaw_of(pose[1])).T + np.asarray(pose[0][:2])
            if env.arm.reachable(np.column_stack([points, np.full(count, 2 * radius)])).all():
                return points
    raise NoFreeSpaceError(
        f"no free place for a rope of {count} beads, {count * spacing:.2f} m, among {len(env.objects)} objects",
        "add fewer objects or a shorter rope",
    )


def _curve(count: int, spacing: float, bend: float) -> FloatArray:
    """Points (count, 2) on an arc that turns by ``bend`` radians, about the middle of their box."""
    headings = bend * (np.arange(count - 1) / max(count - 2, 1) - 0.5)
    steps = spacing * np.stack([np.cos(headings), np.sin(headings)], axis=1)
    points = np.vstack([np.zeros((1, 2)), np.cumsum(steps, axis=0)])
    return points - (points.min(axis=0) + points.max(axis=0)) / 2
