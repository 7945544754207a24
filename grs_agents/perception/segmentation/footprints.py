"""Footprints of round and hollow objects: half ellipses of the visible side, rim of a bowl, open top.

Round objects are completed by symmetry. The two edges of the outline give the width and the lateral position of the
axis. A horizontal slice of the side is the near half of an ellipse of that width; its depth follows by least squares.
"""

from dataclasses import dataclass
from itertools import pairwise

import cv2
import numpy as np

from grs_agents.perception.configuration import DEFAULT
from grs_agents.perception.image_geometry import (
    axes_from_yaws,
    compute_percentiles,
    convex_footprint_hull,
    fit_smallest_rectangle,
    mask_outline_pixels,
    points_in_box_mask,
    points_in_hull_mask,
)
from grs_agents.perception.segmentation.configuration import HollowShape
from grs_agents.perception.types import Array, Mask, RGBDFrame, TableFrame

CONFIG = DEFAULT.measuring.round
RIM = DEFAULT.measuring.rim
HOLLOW = DEFAULT.segmentation.hollow
LEAST_AREA = 5e-4  # of a footprint, m^2: a smaller one has no inside and no middle


@dataclass(frozen=True)
class Ellipse:
    """A footprint: its centre (x, y), its longer and shorter diameter (m), and the yaw of the longer diameter (rad)."""

    center: tuple[float, float]
    diameters: tuple[float, float]
    yaw: float


@dataclass(frozen=True)
class ViewFrame:
    """Viewpoint on an object: the eye, and the horizontal directions along and across the view, all (3,), robot frame.
    ``rays`` are (M, 3) directions of the pixels of the object's outline, of length 1 m along the optical axis;
    ``pixel`` is half a pixel as a slope."""

    eye: Array
    along: Array
    across: Array
    rays: Array
    pixel: float

    def to_view_coordinates(self, points: Array) -> Array:
        """(N, 2) coordinates of (N, 3) points along and across the view."""
        return np.stack([points @ self.along, points @ self.across], axis=1)


def compute_view_frame(frame: RGBDFrame, table: TableFrame, mask: Mask, cloud: Array) -> ViewFrame | None:
    """The viewpoint on an object; ``None`` from straight above."""
    transform = np.asarray(table.T_robot_cam)
    eye = transform[:3, 3]
    along = np.array([*(np.median(cloud[:, :2], axis=0) - eye[:2]), 0.0])
    distance = float(np.linalg.norm(along))
    if distance < 0.1:
        return None
    along /= distance
    camera = frame.camera
    columns, rows = mask_outline_pixels(mask).astype(np.float64).T
    rays = np.stack([(columns - camera.cx) / camera.fx, (rows - camera.cy) / camera.fy, np.ones(len(rows))], axis=1)
    return ViewFrame(eye, along, np.array([-along[1], along[0], 0.0]), rays @ transform[:3, :3].T, 0.5 / camera.fx)


def fit_elliptic_footprint(cloud: Array, view: ViewFrame) -> Ellipse | None:
    """The footprint of a round object by its visible side; ``None`` for a flat, cornered or hidden side."""
    bottom, top = compute_percentiles(cloud[:, 2], (3, 97))
    edges = np.linspace(float(bottom), float(top), CONFIG.slices + 1)
    fits: list[Array] = []
    for low, high in pairwise(edges.tolist()):
        side = view.to_view_coordinates(cloud[(cloud[:, 2] >= low) & (cloud[:, 2] <= high)])
        if len(side) < CONFIG.fewest:
            continue
        fit = _fit_half_ellipse(side, _find_outline_edges(view, float(np.median(side[:, 0])), (low, high)))
        if fit is not None:  # once more: the width of the outline depends on the distance of the axis
            fit = _fit_half_ellipse(side, _find_outline_edges(view, float(fit[0]), (low, high)))
        if fit is not None:
            fits.append(fit)
    if len(fits) < CONFIG.fewest_slices:
        return None
    widest = max(fit[4] for fit in fits)
    along, across, slope, depth, half, *_ = np.median([fit for fit in fits if fit[4] >= CONFIG.widest * widest], axis=0)
    if depth > CONFIG.round * half and abs(slope) < 1 - CONFIG.round:
        # A circle: its outline is measured better than its depth.
        along, slope, depth = along + half - depth, 0.0, half
    axes, diameters, _ = np.linalg.svd(np.array([[depth, slope * half], [0.0, half]]))
    longer = np.stack([view.along, view.across], axis=1) @ axes[:, 0]
    x, y, _ = along * view.along + across * view.across
    yaw = float(np.arctan2(longer[1], longer[0]))
    return Ellipse((float(x), float(y)), (2 * float(diameters[0]), 2 * float(diameters[1])), yaw)


def _fit_half_ellipse(side: Array, edges: tuple[float, float] | None) -> Array | None:
    """The near half of an ellipse fitted to a slice, (N, 2) along and across the view, between the outline's edges.

    Returns: middle along and across the view, slope, half depth and half width, metres; ``None`` without a good fit.
    """
    if edges is None:
        return None
    middle, half = (edges[0] + edges[1]) / 2, (edges[1] - edges[0]) / 2
    near = np.abs(side[:, 1] - middle) < CONFIG.seen * half
    if near.sum() < CONFIG.fewest:
        return None
    points = side[near]
    residuals = _solve_least_squares(points, middle, half)[1]
    points = points[residuals <= compute_percentiles(residuals, [90])]  # without flying pixels
    solution, residuals = _solve_least_squares(points, middle, half)
    error = float(np.sqrt(np.mean(residuals**2)))
    if not CONFIG.depths[0] < solution[2] / half < CONFIG.depths[1] or error > CONFIG.error * half:
        return None
    # A rectangle must fit worse: root mean square distance to the nearest side, over all yaws.
    axes = axes_from_yaws(np.deg2rad(np.arange(-45.0, 45.0, 3.0)))
    flat = points @ axes.reshape(-1, 2).T
    low, high = compute_percentiles(flat, (2, 98))
    distances = np.minimum(np.abs(flat - low), np.abs(flat - high))
    distances = np.minimum(distances[:, 0::2], distances[:, 1::2])
    if error > CONFIG.better * float(np.sqrt((distances**2).mean(axis=0)).min()):
        return None
    return np.array([solution[0], middle, solution[1], solution[2], half])


def _solve_least_squares(points: Array, middle: float, half: float) -> tuple[Array, Array]:
    """Middle along the view, slope and half depth (3,) of the ellipse; and the residual of each point (N,), m."""
    across = points[:, 1] - middle
    terms = np.stack([np.ones(len(across)), across, -np.sqrt(1 - (across / half) ** 2)], axis=1)
    solution = np.asarray(np.linalg.lstsq(terms, points[:, 0], rcond=None)[0], np.float64)
    return solution, np.abs(points[:, 0] - terms @ solution)


def _find_outline_edges(view: ViewFrame, axis: float, heights: tuple[float, float]) -> tuple[float, float] | None:
    """The outline's left and right edge (m across the view) between two heights, at ``axis`` (m along the view)."""
    reach = (axis - view.eye @ view.along) / np.maximum(view.rays @ view.along, 1e-3)
    points = view.eye + reach[:, None] * view.rays
    across = (points @ view.across)[(points[:, 2] >= heights[0]) & (points[:, 2] <= heights[1])]
    if len(across) < 6:
        return None
    middle = (across.min() + across.max()) / 2
    left, right = across[across < middle], across[across >= middle]
    if min(len(left), len(right)) < 3:
        return None
    border = view.pixel * float(np.median(reach))
    return float(np.median(left)) - border, float(np.median(right)) + border


def fit_bowl_rim(cloud: Array) -> tuple[tuple[float, float], float] | None:
    """Centre (x, y) and diameter (m) of the rim of (N, 3) points of an open object; ``None`` if it is no round bowl.

    The rim gives position and width, whatever part of the side is hidden.
    """
    bottom, top = (float(level) for level in compute_percentiles(cloud[:, 2], [2, 98]))
    rim = cloud.compress(cloud[:, 2] > top - RIM.high, axis=0)[:, :2]
    kept, center, radius = rim, np.zeros(2), 0.0
    for _ in range(RIM.rounds):
        if len(kept) < RIM.fewest:
            return None
        center, radius = _fit_circle(kept)
        off = np.abs(np.hypot(*(rim - center).T) - radius)
        kept = rim.compress(off < max(RIM.near, 2 * float(np.median(off))), axis=0)
    local = kept - center
    reach = np.hypot(*local.T)
    sectors = np.floor(np.arctan2(local[:, 1], local[:, 0]) / (2 * np.pi) * RIM.sectors).astype(np.int64)
    height = top - bottom
    if height > RIM.flat * 2 * radius or len(np.unique(sectors)) < RIM.seen * RIM.sectors:
        return None
    beyond = np.hypot(*(cloud[:, :2] - center).T) > RIM.wide * radius
    if (beyond & (cloud[:, 2] > bottom + RIM.low * height)).mean() > RIM.handle:
        return None
    # The rectangle around the rim must fit worse, by mean distance.
    middle, sides, yaw = fit_smallest_rectangle(rim)
    outside = np.abs((rim - middle) @ axes_from_yaws(np.array([yaw]))[0].T) - np.array(sides) / 2
    rectangle_error = float(np.abs(outside.max(axis=1)).mean())
    if np.abs(np.hypot(*(rim - center).T) - radius).mean() > RIM.better * rectangle_error:
        return None
    return (float(center[0]), float(center[1])), 2 * float(compute_percentiles(reach, [95])[0])


def _fit_circle(points: Array) -> tuple[Array, float]:
    """Centre (2,) and radius of the circle nearest to (N, 2) points, by algebraic least squares."""
    middle = points.mean(axis=0)
    local = points - middle
    columns = np.column_stack([2 * local, np.ones(len(local))])
    solution: Array = np.asarray(np.linalg.lstsq(columns, (local**2).sum(axis=1), rcond=None)[0], np.float64)
    return middle + solution[:2], float(np.sqrt(max(float(solution[2] + (solution[:2] ** 2).sum()), 0.0)))


def is_open_at_top(cloud: Array, table: Array, config: HollowShape = HOLLOW) -> bool:
    """Whether an object is hollow: its highest points (N, 3), m above the table, surround a deeper inside. Table points
    (M, 3) within its footprint count as its floor."""
    top = float(compute_percentiles(cloud[:, 2], [98])[0])
    if top < 2 * config.deep:
        return False
    hull = convex_footprint_hull(cloud)
    area = float(cv2.contourArea(hull.astype(np.float32)))
    rim = cloud.compress(cloud[:, 2] > top - config.rim, axis=0)
    if (
        area < LEAST_AREA
        or float(cv2.contourArea(convex_footprint_hull(rim).astype(np.float32))) < config.surrounded * area
    ):
        return False
    near = table.compress(points_in_box_mask(table[:, :2], hull.min(axis=0), hull.max(axis=0)), axis=0)
    points = np.concatenate([cloud, near])
    inner = points[points_in_hull_mask(points[:, :2], hull, -min(config.rim, 0.15 * area**0.5))]
    return float((inner[:, 2] > top - config.deep).sum()) < config.shallow * len(inner) or len(inner) < 10


def is_solid_object(cloud: Array, config: HollowShape = HOLLOW) -> bool:
    """Whether (N, 3) points are the top of a solid object: its whole footprint is seen, highest in the middle.

    The inside of a hollow object is lowest in the middle, a wall is too thin to have a middle, and a floor lies on the
    table.
    """
    hull = convex_footprint_hull(cloud)
    area = float(cv2.contourArea(hull.astype(np.float32)))
    if area < LEAST_AREA:
        return False
    cell, low = area**0.5 / config.cells, hull.min(axis=0)
    columns, rows = np.floor((cloud[:, :2] - low) / cell).astype(np.int64).T
    tops = np.full((int(columns.max()) + 1, int(rows.max()) + 1), -np.inf)
    np.maximum.at(tops, (columns, rows), cloud[:, 2])
    centers = (np.indices(tops.shape).reshape(2, -1).T + 0.5) * cell + low
    heights = tops.ravel()
    inside, middle = points_in_hull_mask(centers, hull, 0.0), points_in_hull_mask(centers, hull, -1.5 * cell)
    seen = np.isfinite(heights)
    if not (middle & seen).any() or seen[inside].mean() < config.filled or seen[middle].mean() < config.filled:
        return False
    inner = float(np.median(heights[middle & seen]))
    outer = float(compute_percentiles(heights[inside & seen & ~middle], [80])[0])  # a slope is higher on one side
    return inner > max(config.raised, outer - config.sag)
