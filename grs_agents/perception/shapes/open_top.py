"""A round cup or an open box, fitted to what is open at the top: often little but its floor is measured."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from grs_agents.geometry import to_vec3
from grs_agents.perception.proxies import box_mesh, join_meshes
from grs_agents.perception.shapes.colliders import open_box_colliders
from grs_agents.perception.shapes.configuration import DEFAULT
from grs_agents.perception.shapes.drawing import draw_depth
from grs_agents.perception.shapes.lathe import TurnedSolid, mesh_turned_solid
from grs_agents.perception.shapes.observation import Observation
from grs_agents.perception.shapes.revolution import Axis
from grs_agents.perception.shapes.surface_nets import Faces
from grs_agents.perception.types import Array

CONFIG = DEFAULT.open_top


@dataclass(frozen=True)
class _Fitted:
    """A fitted shape and how far it is from the view."""

    values: Array  # of its parameters, m
    cost: float  # see `cost_of_mesh`


def fit_open_top(seen: Observation, size: tuple[float, float, float]) -> TurnedSolid | tuple[Array, Faces]:
    """The round cup with straight walls and a floor, or the mesh of the open box, that agrees better with the view.
    ``size`` is that of the measured box, m."""
    small, radius = _reduced(seen), (size[0] + size[1]) / 4

    def cost_of_cup(values: Array) -> float:
        return cost_of_mesh(small, *mesh_turned_solid(_cup(values, 2), CONFIG.faces))

    def cost_of_box(values: Array) -> float:
        return cost_of_mesh(small, *_open_box(values, 1))

    corners = np.array([-size[0] / 2, -size[1] / 2, size[0] / 2, size[1] / 2, size[2]])
    cup = _search(np.array([0.0, 0.0, radius, radius, size[2]]), cost_of_cup, CONFIG.first_steps)
    box = _search(corners, cost_of_box, CONFIG.first_steps)
    if cup.cost < box.cost:
        return _cup(_search(cup.values, cost_of_cup, CONFIG.last_steps).values, CONFIG.levels)
    return _open_box(_search(box.values, cost_of_box, CONFIG.last_steps).values, CONFIG.grid)


def _cup(values: Array, levels: int) -> TurnedSolid:
    x, y, foot, rim, height = (
        float(value) for value in np.maximum(values, (-np.inf, -np.inf, *3 * (CONFIG.least / 2,)))
    )
    heights: Array = np.linspace(0.0, height, levels)
    outer: Array = np.linspace(foot, rim, levels)
    inside: Array = np.concatenate([[CONFIG.wall], heights[1:]])
    around: Array = np.interp(inside, heights, outer)
    walls = np.stack([around - CONFIG.wall, around, inside], axis=1)
    side = np.stack([outer, heights], axis=1)
    profile = np.concatenate([np.zeros((1, 2)), side, walls[::-1, [0, 2]], [(0.0, CONFIG.wall)]])
    return TurnedSolid(Axis(x, y, 1.0, 2 * np.pi), profile, side[:, ::-1], walls)


def _open_box(values: Array, grid: int) -> tuple[Array, Faces]:
    low = np.array([*values[:2], 0.0])
    high = np.maximum(values[2:], low + CONFIG.least)
    return join_meshes([box_mesh(to_vec3(one.size), one.position, grid) for one in open_box_colliders(low, high)])


def _reduced(seen: Observation) -> Observation:
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


def _search(start: Array, cost: Callable[[Array], float], steps: tuple[float, ...]) -> _Fitted:
    """Each value in turn moves by a step as long as that helps; then the next step is taken."""
    best = _Fitted(start, cost(start))
    for step in steps:
        for _ in range(CONFIG.rounds):
            before = best.cost
            for number in range(len(start)):
                for way in (step, -step):
                    values = best.values.copy()
                    values[number] += way
                    tried = _Fitted(values, cost(values))
                    if tried.cost < best.cost:
                        best = tried
                        break
            if best.cost == before:
                break
    return best


def cost_of_mesh(seen: Observation, vertices: Array, faces: Faces) -> float:
    """Pixels that only one of mesh and mask covers, and those of both by how far the mesh is off in depth; as a share
    of the mask."""
    drawn = draw_depth(seen, vertices, faces)
    shown, known = drawn > 0, seen.measured > 0
    hidden = ~seen.mask & known & shown & (seen.measured < drawn - DEFAULT.observation.nearer)
    off = np.minimum(np.abs(drawn - seen.measured)[shown & seen.mask & known] / CONFIG.far, 1.0)
    apart = np.count_nonzero((shown & ~hidden) != seen.mask)
    return (apart + float(off.sum())) / max(np.count_nonzero(seen.mask), 1)
