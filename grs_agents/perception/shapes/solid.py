"""Things that are not round: the space that the view and its mirror images leave, on a grid."""

import numpy as np

from grs_agents.base.geometry.hulls import hull_half_spaces
from grs_agents.perception.shapes import surface_nets
from grs_agents.perception.shapes.configuration import DEFAULT
from grs_agents.perception.shapes.mesh_simplification import simplify_closed_mesh
from grs_agents.perception.shapes.mirrors import Mirror
from grs_agents.perception.shapes.observation import FAR, Observation
from grs_agents.perception.shapes.surface_nets import Faces
from grs_agents.perception.types import Array

CONFIG = DEFAULT.solid


def carve_solid(seen: Observation, mirrors: list[Mirror], most_faces: int) -> tuple[Array, Faces] | None:
    """The closed mesh of what the view and its images in the mirrors leave of the hull of what is seen, measured or
    not, of the images of what was measured and of its footprint; ``None`` where nothing is left."""
    images = [seen.points, *(mirror.image(seen.points) for mirror in mirrors)]
    if len(mirrors) == 2:
        images.append(mirrors[1].image(images[1]))
    farthest = seen.project(seen.points)[2].max(initial=0.0)  # what seems to lie behind all of it was guessed
    shown = seen.lift(seen.depth)[seen.mask & (seen.edge < -1) & (seen.depth <= farthest)]
    known = np.concatenate([*images, shown[:: max(1, len(shown) // CONFIG.hull_points)]])
    body = np.concatenate([known, known * (1, 1, 0)])
    low, high = body.min(axis=0) - CONFIG.margin, body.max(axis=0) + CONFIG.margin
    step = max(CONFIG.finest, float((high - low).max()) / CONFIG.cells)
    low[2] = (CONFIG.lowest - 2) * step
    counts = np.ceil((high - low) / step).astype(int) + 1
    grid = np.indices(tuple(counts)).reshape(3, -1).T * step + low
    values = seen.free_distance(grid)
    open_ = np.flatnonzero(~(values >= FAR))  # the rest is free whatever is mirrored
    values[open_] = _signed_distance_to_solid(seen, mirrors, body, grid[open_], step)
    values = np.clip(np.maximum(values, -grid[:, 2]), -FAR, FAR).reshape(tuple(counts))
    if values.min() >= 0:
        return None
    vertices, faces = surface_nets.mesh_zero_level(values, low, step)
    vertices, faces = surface_nets.keep_large_pieces(vertices, faces, CONFIG.smallest_piece)
    vertices = surface_nets.smooth_mesh(vertices, faces, CONFIG.smoothing)
    return simplify_closed_mesh(vertices, faces, most_faces)


def _signed_distance_to_solid(
    seen: Observation, mirrors: list[Mirror], body: Array, places: Array, step: float
) -> Array:
    """(N,) how far places (N, 3) lie outside the solid, m, less than 0 inside."""
    own = seen.free_distance(places)
    views = [own, *(np.minimum(seen.free_distance(mirror.image(places)), 0.5 * FAR) for mirror in mirrors)]
    if len(mirrors) == 2:
        views.append(seen.free_distance(mirrors[1].image(mirrors[0].image(places))))
    values = np.fmax.reduce(views)
    values = np.where(np.isnan(values), -FAR, values)  # seen by none: the hull says
    values = np.maximum(values, _signed_distance_to_hull(body, places))
    shell = np.maximum(own, seen.depth_behind_surface(places) - max(CONFIG.wall, 1.4 * step))
    return np.fmin(values, shell)  # what is seen stays, however thin the rest came out


def _signed_distance_to_hull(points: Array, grid: Array) -> Array:
    """(G,) how far places (G, 3) lie outside the convex hull of points (N, 3), m, less than 0 inside."""
    planes = hull_half_spaces(points[:: max(1, len(points) // CONFIG.hull_points)])
    planes = planes[np.unique(np.round(planes, 2), axis=0, return_index=True)[1]].astype(np.float32)
    places, found = grid.astype(np.float32), np.full(len(grid), -np.inf, np.float32)
    for plane in planes:
        np.maximum(found, places @ plane[:3] - plane[3], out=found)
    return found.astype(np.float64)
