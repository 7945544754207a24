"""A round cup or an open box, fitted to what is open at the top: often little but its floor is measured."""

import numpy as np

from grs_agents.base.geometry.transforms import to_vec3
from grs_agents.perception.proxies.meshes import box_mesh, join_meshes
from grs_agents.perception.shapes.colliders import open_box_colliders
from grs_agents.perception.shapes.configuration import DEFAULT
from grs_agents.perception.shapes.lathe import TurnedSolid, mesh_turned_solid
from grs_agents.perception.shapes.observation import Observation
from grs_agents.perception.shapes.revolution import Axis
from grs_agents.perception.shapes.surface_nets import Faces
from grs_agents.perception.shapes.view_fit import cost_of_mesh, reduce_observation, search_lengths
from grs_agents.perception.types import Array

CONFIG = DEFAULT.open_top


def fit_open_top(seen: Observation, size: tuple[float, float, float]) -> TurnedSolid | tuple[Array, Faces]:
    """The round cup with straight walls and a floor, or the mesh of the open box, that agrees better with the view.
    ``size`` is that of the measured box, m."""
    small, radius = reduce_observation(seen), (size[0] + size[1]) / 4

    def cost_of_cup(values: Array) -> float:
        return cost_of_mesh(small, *mesh_turned_solid(_cup(values, 2), DEFAULT.view_fit.faces))

    def cost_of_box(values: Array) -> float:
        return cost_of_mesh(small, *_open_box(values, 1))

    corners = np.array([-size[0] / 2, -size[1] / 2, size[0] / 2, size[1] / 2, size[2]])
    cup = search_lengths(np.array([0.0, 0.0, radius, radius, size[2]]), cost_of_cup, CONFIG.first_steps)
    box = search_lengths(corners, cost_of_box, CONFIG.first_steps)
    if cup.cost < box.cost:
        return _cup(search_lengths(cup.values, cost_of_cup, CONFIG.last_steps).values, CONFIG.levels)
    return _open_box(search_lengths(box.values, cost_of_box, CONFIG.last_steps).values, DEFAULT.view_fit.grid)


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
