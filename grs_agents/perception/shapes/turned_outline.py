"""What the mask's outline tells of a round object: where its axis stands, its radius by height, and its top."""

from dataclasses import replace

import cv2
import numpy as np

from grs_agents.perception.shapes.configuration import DEFAULT
from grs_agents.perception.shapes.observation import Observation, sample
from grs_agents.perception.shapes.revolution import Axis
from grs_agents.perception.types import Array

CONFIG = DEFAULT.outline


def silhouette_radii_by_side(seen: Observation, axis: Axis, heights: Array, largest: float) -> Array:
    """(S, 2) up to which radius the ring at each height lies inside the mask on the left and on the right of the view,
    m; NaN where something nearer hides that side."""
    to_eye = seen.eye[:2] - (axis.x, axis.y)
    distance, toward = float(np.linalg.norm(to_eye)), float(np.arctan2(to_eye[1], to_eye[0]))
    radii = np.arange(CONFIG.step, largest + CONFIG.step, CONFIG.step)
    turn = np.arccos(np.minimum(radii / distance, 1.0))  # of the ring's outermost point, as seen
    angles = toward + turn[:, None] * (1, -1)
    places = np.empty((len(heights), len(radii), 2, 3))
    places[..., 0] = axis.x + radii[:, None] * np.cos(angles)
    places[..., 1] = axis.y + radii[:, None] * np.sin(angles)
    places[..., 2] = heights[:, None, None]
    outside = _pixel_distance_outside_mask(seen, places.reshape(-1, 3)).reshape(places.shape[:3])
    left = outside > 0
    first = np.where(left.any(axis=1), left.argmax(axis=1), len(radii) - 1)
    hidden = np.isnan(np.take_along_axis(outside, first[:, None], axis=1)[:, 0])
    return np.where(hidden, np.nan, radii[first])


def _pixel_distance_outside_mask(seen: Observation, places: Array) -> Array:
    """(N,) pixels outside the mask, less than 0 inside, of places (N, 3); NaN once something nearer hides them."""
    column, row, depth = seen.project(places)
    outside = sample(seen.edge, column, row, cv2.INTER_LINEAR, 50.0)
    measured = sample(seen.measured, column, row, cv2.INTER_NEAREST, 0.0)
    return np.where((outside > 0) & (measured > 0) & (measured < depth - CONFIG.nearer), np.nan, outside)


def center_axis_in_outline(axis: Axis, seen: Observation, sides: Array) -> Axis:
    """The axis moved across the view to the middle between both sides of the outline, where most heights agree."""
    off = (sides[:, 0] - sides[:, 1]) / 2
    off = off[np.abs(off) < CONFIG.off_center]  # a handle is farther off
    if len(off) < CONFIG.fewest or np.ptp(np.percentile(off, [25, 75])) > CONFIG.agreed:
        return axis
    to_eye = seen.eye[:2] - (axis.x, axis.y)
    across = np.array([-to_eye[1], to_eye[0]]) / np.linalg.norm(to_eye)
    shift = float(np.median(off)) * across
    return replace(axis, x=axis.x + float(shift[0]), y=axis.y + float(shift[1]))


def combine_depth_and_outline_radii(measured: Array, sides: Array, noise: float) -> Array:
    """(S,) radius by height from depth (S,), NaN where unknown, and from the outline (S, 2), half-way between them:
    masks are as often too wide as depth ends too early. What depth does not tell the outline does."""
    with np.errstate(invalid="ignore"):
        outline = np.fmin(sides[:, 0], sides[:, 1])
        wider = outline - measured
        off = wider[np.abs(wider) < CONFIG.near + 2 * noise]
    half = float(np.median(off)) / 2 if len(off) else 0.0
    return np.fmin(np.where(np.isnan(measured), outline - half, measured + half), outline)


def refine_rim_height(seen: Observation, axis: Axis, radius: float, height: float) -> float:
    """The height of a rim of a radius, m: half-way between ``height``, as it was measured, and that up to which its far
    side lies inside the mask."""
    away = np.array([axis.x, axis.y]) - seen.eye[:2]
    far = (axis.x, axis.y) + radius * away / np.linalg.norm(away)
    reach = CONFIG.near + 2 * seen.noise
    heights = np.arange(height - reach, height + reach, CONFIG.step / 2)
    outside = _pixel_distance_outside_mask(seen, np.column_stack([np.broadcast_to(far, (len(heights), 2)), heights]))
    if np.isnan(outside).any() or not (outside[0] <= 0 < outside[-1]):
        return height
    return (height + float(heights[np.argmax(outside > 0)])) / 2
