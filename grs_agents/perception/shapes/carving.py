"""Objects that are not round: space carving from the view and its mirror images, on a grid."""

from dataclasses import dataclass

import numpy as np

from grs_agents.base.geometry.hulls import hull_half_spaces
from grs_agents.perception.shapes.configuration import DEFAULT
from grs_agents.perception.shapes.mesh_simplification import simplify_closed_mesh
from grs_agents.perception.shapes.object_crop import FAR, ObjectCrop
from grs_agents.perception.shapes.surface_nets import Faces, keep_large_pieces, mesh_zero_level, smooth_mesh
from grs_agents.perception.types import Array

CONFIG = DEFAULT.solid
MIRRORS = DEFAULT.mirrors


@dataclass(frozen=True)
class Mirror:
    """An upright plane of symmetry, object frame, and its support by the view."""

    normal: Array  # (3,) of unit length, level
    offset: float  # of the plane along the normal, m
    support: float  # share of the mirrored points that lie on the seen surface
    facing: float  # share of the mirrored points that lie on the seen surface and face the camera
    breach: float  # share of the mirrored points that lie in free space

    def image(self, points: Array) -> Array:
        """Points (N, 3) mirrored."""
        return points - 2 * np.outer(points @ self.normal - self.offset, self.normal)


def find_symmetry_planes(crop: ObjectCrop) -> list[Mirror]:
    """The best plane, and the best at a right angle to it; none without a mirror image that agrees with the view."""
    planes = _score_symmetry_planes(crop)
    good = [plane for plane in planes if plane.breach < MIRRORS.breach and plane.support > MIRRORS.support]
    if not good:
        return []
    best = _nearest_to_middle(good)

    def angle_cosine(plane: Mirror) -> float:
        return abs(float(plane.normal @ best.normal))

    # A plane in a face that is seen from the front mirrors it onto itself, turned over.
    facing = [plane for plane in good if plane.facing > MIRRORS.facing * plane.support]
    across = [plane for plane in facing if angle_cosine(plane) < MIRRORS.right_angle]
    if across:
        return [best, _nearest_to_middle(across)]
    # The images of a frontal face are occluded, and only the top supports a plane across: the nearest to the camera
    # without breach.
    likely = [plane for plane in planes if plane.breach < MIRRORS.unbreached]
    likely = [plane for plane in likely if plane.support > MIRRORS.hidden_support]
    across = [plane for plane in likely if angle_cosine(plane) < MIRRORS.across]
    return [best, *sorted(across, key=lambda plane: abs(float(crop.eye @ plane.normal) - plane.offset))[:1]]


def _nearest_to_middle(planes: list[Mirror]) -> Mirror:
    """Of the planes in the best direction with nearly the best score, the nearest to the middle of the measured box:
    nothing contradicts a plane behind the object."""

    def score(plane: Mirror) -> float:
        return plane.support - MIRRORS.breach_weight * plane.breach

    best = max(planes, key=score)
    least = score(best) - MIRRORS.alike
    alike = [plane for plane in planes if (plane.normal == best.normal).all() and score(plane) >= least]
    return min(alike, key=lambda plane: abs(plane.offset))


def _score_symmetry_planes(crop: ObjectCrop) -> list[Mirror]:
    """Planes at many angles and offsets with their support; those that a first sample of the points breaches too much
    are left out."""
    step = max(1, len(crop.points) // MIRRORS.points)
    points, normals = crop.points[::step], crop.normals[::step]
    tolerance = max(MIRRORS.tolerance, MIRRORS.tolerance_deviations * crop.noise)
    planes: list[Mirror] = []
    for angle in np.arange(MIRRORS.angles) * np.pi / MIRRORS.angles:
        normal = np.array([np.cos(angle), np.sin(angle), 0.0])
        along = points @ normal
        low, high = (float(end) for end in np.percentile(along, (1, 99)))
        offsets: Array = np.linspace(low, high, MIRRORS.offsets)
        few = slice(None, None, MIRRORS.first)
        free = _free_distance_of_images(crop, points[few], along[few], offsets, normal)
        offsets = offsets[(free > tolerance).sum(axis=1) / len(points) < MIRRORS.breach]
        if not len(offsets):
            continue
        free = _free_distance_of_images(crop, points, along, offsets, normal)
        on_surface, breach = np.abs(free) < tolerance, (free > tolerance).mean(axis=1)  # NaN is neither
        mirrored = normals - 2 * np.outer(normals @ normal, normal)
        to_camera = ((crop.eye - points) * mirrored).sum(axis=1)
        facing = on_surface & (to_camera + 2 * (along - offsets[:, None]) * (mirrored @ normal) > 0)
        planes += [
            Mirror(normal, *(float(value) for value in values))
            for values in zip(offsets, on_surface.mean(axis=1), facing.mean(axis=1), breach, strict=True)
        ]
    return planes


def _free_distance_of_images(crop: ObjectCrop, points: Array, along: Array, offsets: Array, normal: Array) -> Array:
    """(O, N) free distance of the mirror images of points (N, 3), at ``along`` (N,) on the normal, in planes at
    ``offsets`` (O,)."""
    images = points[None] - 2 * (along[None] - offsets[:, None])[..., None] * normal
    return crop.free_distance(images.reshape(-1, 3)).reshape(len(offsets), len(points))


def carve_solid(crop: ObjectCrop, mirrors: list[Mirror], most_faces: int) -> tuple[Array, Faces] | None:
    """Closed mesh of the visual hull: space carving from the view and its mirrored copies, clipped to the convex hull
    of the (mirrored) points and their footprint; ``None`` if nothing is left."""
    images = [crop.points, *(mirror.image(crop.points) for mirror in mirrors)]
    if len(mirrors) == 2:
        images.append(mirrors[1].image(images[1]))
    farthest = crop.project(crop.points)[2].max(initial=0.0)  # filled depth behind it is a guess
    shown = crop.lift(crop.depth)[crop.mask & (crop.edge < -1) & (crop.depth <= farthest)]
    known = np.concatenate([*images, shown[:: max(1, len(shown) // CONFIG.hull_points)]])
    body = np.concatenate([known, known * (1, 1, 0)])
    low, high = body.min(axis=0) - CONFIG.margin, body.max(axis=0) + CONFIG.margin
    step = max(CONFIG.finest, float((high - low).max()) / CONFIG.cells)
    low[2] = (CONFIG.lowest - 2) * step
    counts = np.ceil((high - low) / step).astype(int) + 1
    grid = np.indices(tuple(counts)).reshape(3, -1).T * step + low
    values = crop.free_distance(grid)
    undecided = np.flatnonzero(~(values >= FAR))  # the rest is free in the view itself
    values[undecided] = _signed_distance_to_solid(crop, mirrors, body, grid[undecided], step)
    values = np.clip(np.maximum(values, -grid[:, 2]), -FAR, FAR).reshape(tuple(counts))
    if values.min() >= 0:
        return None
    vertices, faces = mesh_zero_level(values, low, step)
    vertices, faces = keep_large_pieces(vertices, faces, CONFIG.smallest_piece)
    vertices = smooth_mesh(vertices, faces, CONFIG.smoothing)
    return simplify_closed_mesh(vertices, faces, most_faces)


def _signed_distance_to_solid(
    crop: ObjectCrop, mirrors: list[Mirror], body: Array, places: Array, step: float
) -> Array:
    """(N,) signed distance of points (N, 3) to the carved solid, m, negative inside; ``body`` (M, 3) spans its hull."""
    seen = crop.free_distance(places)
    views = [seen, *(np.minimum(crop.free_distance(mirror.image(places)), 0.5 * FAR) for mirror in mirrors)]
    if len(mirrors) == 2:
        views.append(crop.free_distance(mirrors[1].image(mirrors[0].image(places))))
    values = np.fmax.reduce(views)
    values = np.where(np.isnan(values), -FAR, values)  # in no view: the hull decides
    planes = hull_half_spaces(body[:: max(1, len(body) // CONFIG.hull_points)])
    planes = planes[np.unique(np.round(planes, 2), axis=0, return_index=True)[1]].astype(np.float32)
    single, hull = places.astype(np.float32), np.full(len(places), -np.inf, np.float32)
    for plane in planes:
        np.maximum(hull, single @ plane[:3] - plane[3], out=hull)
    values = np.maximum(values, hull.astype(np.float64))
    shell = np.maximum(seen, crop.depth_behind_surface(places) - max(CONFIG.wall, 1.4 * step))
    return np.fmin(values, shell)  # the seen surface stays, however thin the rest
