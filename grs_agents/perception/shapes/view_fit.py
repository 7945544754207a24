"""Boxes and turned solids moved and sized until they agree with the view: its mask and its depth."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from grs_agents.base.geometry.transforms import to_vec3
from grs_agents.perception.proxies.meshes import box_mesh
from grs_agents.perception.shapes.configuration import DEFAULT
from grs_agents.perception.shapes.drawing import draw_depth
from grs_agents.perception.shapes.lathe import TurnedSolid, mesh_turned_solid
from grs_agents.perception.shapes.observation import Observation
from grs_agents.perception.shapes.surface_nets import Faces
from grs_agents.perception.types import Array

CONFIG = DEFAULT.view_fit


@dataclass(frozen=True)
class Fitted:
    """Lengths of a shape, and how far it is from the view."""

    values: Array  # (N,) m
    cost: float  # see `cost_of_mesh`


def fit_box(seen: Observation, size: tuple[float, float, float]) -> tuple[Array, Faces]:
    """The mesh of the upright box that agrees best with the view, near the measured one of a ``size``, m."""
    small, radius = reduce_observation(seen), float(np.hypot(*size[:2])) / 2

    def box(values: Array, grid: int) -> tuple[Array, Faces]:
        low = np.array([*values[:2], 0.0])
        high = np.maximum(values[2:5], low + CONFIG.thinnest)
        vertices, faces = box_mesh(to_vec3(high - low), (0.0, 0.0, high[2] / 2), grid)
        cosine, sine = np.cos(values[5] / radius), np.sin(values[5] / radius)
        turned = vertices @ np.array([[cosine, sine, 0], [-sine, cosine, 0], [0, 0, 1]])
        return turned + np.array([*(low + high)[:2] / 2, 0.0]), faces

    measured = np.array([-size[0] / 2, -size[1] / 2, size[0] / 2, size[1] / 2, size[2], 0.0])
    fitted = search_lengths(measured, lambda values: cost_of_mesh(small, *box(values, 1)), CONFIG.box_steps)
    return box(fitted.values, CONFIG.grid)


def fit_turned_solid(seen: Observation, turned: TurnedSolid) -> TurnedSolid:
    """A turned solid, moved and with all its radii and heights in proportion, as it agrees best with the view."""
    small, (vertices, faces) = reduce_observation(seen), mesh_turned_solid(turned, CONFIG.faces)
    axis, widest = turned.axis, float(turned.profile[:, 0].max())
    foot = np.array([axis.x, axis.y, 0.0])

    def factors(values: Array) -> tuple[float, float]:
        return max(1 + values[2] / widest, CONFIG.least), max(1 + values[3] / turned.top, CONFIG.least)

    def cost(values: Array) -> float:
        wider, higher = factors(values)
        return cost_of_mesh(
            small, foot + np.array([*values[:2], 0.0]) + (vertices - foot) * (wider, wider, higher), faces
        )

    values = search_lengths(np.zeros(4), cost, CONFIG.turned_steps).values
    wider, higher = factors(values)
    return TurnedSolid(
        replace(axis, x=axis.x + float(values[0]), y=axis.y + float(values[1])),
        turned.profile * (wider, higher),
        turned.outer * (higher, wider),
        None if turned.walls is None else turned.walls * (wider, wider, higher),
    )


def search_lengths(start: Array, cost: Callable[[Array], float], steps: tuple[float, ...]) -> Fitted:
    """Each value in turn moves by a step as long as that helps; then the next step is taken."""
    best = Fitted(start, cost(start))
    for step in steps:
        for _ in range(CONFIG.rounds):
            before = best.cost
            for number in range(len(start)):
                for way in (step, -step):
                    values = best.values.copy()
                    values[number] += way
                    tried = Fitted(values, cost(values))
                    if tried.cost < best.cost:
                        best = tried
                        break
            if best.cost == before:
                break
    return best


def reduce_observation(seen: Observation) -> Observation:
    """The view with fewer pixels, enough to fit to."""
    step = max(1, -(-max(seen.mask.shape) // CONFIG.pixels))
    few = np.s_[::step, ::step]
    return replace(
        seen,
        mask=seen.mask[few],
        measured=seen.measured[few],
        focal=(seen.focal[0] / step, seen.focal[1] / step),
        center=(seen.center[0] / step, seen.center[1] / step),
    )


def cost_of_mesh(seen: Observation, vertices: Array, faces: Faces) -> float:
    """Pixels that only one of mesh and mask covers, and those of both by how far the mesh is off in depth; as a share
    of the mask."""
    drawn = draw_depth(seen, vertices, faces)
    shown, known = drawn > 0, seen.measured > 0
    hidden = ~seen.mask & known & shown & (seen.measured < drawn - DEFAULT.observation.nearer)
    off = np.minimum(np.abs(drawn - seen.measured)[shown & seen.mask & known] / CONFIG.far, 1.0)
    apart = np.count_nonzero((shown & ~hidden) != seen.mask)
    return (apart + float(off.sum())) / max(np.count_nonzero(seen.mask), 1)
