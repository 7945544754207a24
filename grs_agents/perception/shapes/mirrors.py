"""Upright planes in which an object is its own mirror image, as far as the view can tell."""

from dataclasses import dataclass

import numpy as np

from grs_agents.perception.shapes.configuration import DEFAULT
from grs_agents.perception.shapes.observation import Observation
from grs_agents.perception.types import Array, Mask

CONFIG = DEFAULT.mirrors


@dataclass(frozen=True)
class Mirror:
    """An upright plane, object frame."""

    normal: Array  # (3,) of unit length, level
    offset: float  # of the plane along the normal, m
    support: float  # share of the mirrored points that lie on the seen surface
    facing: float  # share of them that do, and face the camera as what is seen does
    breach: float  # share of them that lie where the view saw through

    def image(self, points: Array) -> Array:
        """Points (N, 3) mirrored."""
        return points - 2 * np.outer(points @ self.normal - self.offset, self.normal)


def find_symmetry_planes(seen: Observation) -> list[Mirror]:
    """The best plane, and the best at a right angle to it; none where no mirror image agrees with the view."""
    planes = _score_symmetry_planes(seen)
    good = [one for one in planes if one.breach < CONFIG.breach and one.support > CONFIG.support]
    if not good:
        return []
    best = _nearest_to_middle(good)
    # A plane in a face that is seen from the front mirrors it onto itself, turned over.
    facing = [one for one in good if one.facing > CONFIG.facing * one.support]
    across = [one for one in facing if abs(float(one.normal @ best.normal)) < CONFIG.right_angle]
    return [best, _nearest_to_middle(across)] if across else [best, *_plane_of_hidden_images(planes, best, seen)]


def _nearest_to_middle(planes: list[Mirror]) -> Mirror:
    """Of the planes in the best direction that agree nearly as well with the view, the nearest to the middle of the
    measured box: what lies behind the object nothing speaks against."""

    def score(one: Mirror) -> float:
        return one.support - CONFIG.breach_weight * one.breach

    best = max(planes, key=score)
    alike = [one for one in planes if (one.normal == best.normal).all() and score(one) >= score(best) - CONFIG.alike]
    return min(alike, key=lambda one: abs(one.offset))


def _plane_of_hidden_images(planes: list[Mirror], best: Mirror, seen: Observation) -> list[Mirror]:
    """Where a face is seen from the front its images are hidden, and only what is on top tells where the plane across
    ``best`` is: the nearest to the camera that none of them breaches. At most one."""
    likely = [one for one in planes if one.breach < CONFIG.unbreached and one.support > CONFIG.hidden_support]
    across = [one for one in likely if abs(float(one.normal @ best.normal)) < CONFIG.across]
    return sorted(across, key=lambda one: abs(float(seen.eye @ one.normal) - one.offset))[:1]


def _score_symmetry_planes(seen: Observation) -> list[Mirror]:
    """Planes at many angles and places, each with what speaks for it and against it, without those against which
    enough is said by the first points that are mirrored."""
    step = max(1, len(seen.points) // CONFIG.points)
    points, normals = seen.points[::step], seen.normals[::step]
    tolerance = max(CONFIG.tolerance, CONFIG.tolerance_deviations * seen.noise)
    planes: list[Mirror] = []
    for angle in np.arange(CONFIG.angles) * np.pi / CONFIG.angles:
        normal = np.array([np.cos(angle), np.sin(angle), 0.0])
        along = points @ normal
        low, high = (float(end) for end in np.percentile(along, (1, 99)))
        offsets: Array = np.linspace(low, high, CONFIG.offsets)
        few = slice(None, None, CONFIG.first)
        free = _free_distance_of_images(seen, points[few], along[few], offsets, normal)
        offsets = offsets[(free > tolerance).sum(axis=1) / len(points) < CONFIG.breach]
        if not len(offsets):
            continue
        free = _free_distance_of_images(seen, points, along, offsets, normal)
        on_surface, breach = np.abs(free) < tolerance, (free > tolerance).mean(axis=1)  # NaN is neither
        facing = on_surface & _is_facing_camera(seen, points, normals, along, offsets, normal)
        planes += [
            Mirror(normal, *(float(value) for value in values))
            for values in zip(offsets, on_surface.mean(axis=1), facing.mean(axis=1), breach, strict=True)
        ]
    return planes


def _is_facing_camera(
    seen: Observation, points: Array, normals: Array, along: Array, offsets: Array, normal: Array
) -> Mask:
    """(O, N) whether the images of points (N, 3) with ``normals`` (N, 3) in planes at ``offsets`` face the camera."""
    turned = normals - 2 * np.outer(normals @ normal, normal)
    to_camera = ((seen.eye - points) * turned).sum(axis=1) + 2 * (along - offsets[:, None]) * (turned @ normal)
    return np.asarray(to_camera > 0, np.bool_)


def _free_distance_of_images(seen: Observation, points: Array, along: Array, offsets: Array, normal: Array) -> Array:
    """(O, N) how far the images of points (N, 3), ``along`` the normal, in planes at ``offsets`` lie in free space."""
    images = points[None] - 2 * (along[None] - offsets[:, None])[..., None] * normal
    return seen.free_distance(images.reshape(-1, 3)).reshape(len(offsets), len(points))
