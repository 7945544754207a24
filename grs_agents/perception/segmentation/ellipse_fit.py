"""Complete round objects of which the camera sees the front: their unseen back mirrors what is seen.

The two edges of an object's outline say how wide it is and where its axis lies across the view. A horizontal slice of
its side is then the near half of an ellipse of that width, whose middle and depth follow by least squares."""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from grs_agents.perception.configuration import DEFAULT
from grs_agents.perception.image_geometry import axes_from_yaws, compute_percentiles, mask_outline_pixels
from grs_agents.perception.types import Array, Mask, RGBDFrame, TableFrame

CONFIG = DEFAULT.measuring.round


@dataclass(frozen=True)
class Ellipse:
    """A footprint: its centre (x, y), its longer and shorter diameter (m), and the yaw of the longer one (rad)."""

    center: tuple[float, float]
    diameters: tuple[float, float]
    yaw: float


@dataclass(frozen=True)
class View:
    """Where an object is seen from: the eye, and the horizontal directions along and across the view.
    ``rays`` are (M, 3) directions of the pixels of the object's outline, of length 1 m along the optical axis."""

    eye: Array
    along: Array
    across: Array
    rays: Array
    pixel: float

    def to_view_coordinates(self, points: Array) -> Array:
        """(N, 2) coordinates of (N, 3) points along and across the view."""
        return np.stack([points @ self.along, points @ self.across], axis=1)


def compute_object_view(frame: RGBDFrame, table: TableFrame, mask: Mask, cloud: Array) -> View | None:
    """The view of one object; ``None`` from straight above."""
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
    return View(eye, along, np.array([-along[1], along[0], 0.0]), rays @ transform[:3, :3].T, 0.5 / camera.fx)


def fit_elliptic_footprint(cloud: Array, view: View) -> Ellipse | None:
    """The footprint of a round object whose side is seen; ``None`` where its side is flat, cornered or hidden."""
    bottom, top = compute_percentiles(cloud[:, 2], (3, 97))
    edges = np.linspace(float(bottom), float(top), CONFIG.slices + 1)
    fits: list[Array] = []
    for low, high in pairwise(edges):
        side = view.to_view_coordinates(cloud[(cloud[:, 2] >= low) & (cloud[:, 2] <= high)])
        if len(side) >= CONFIG.fewest and (fit := _fit_half_ellipse(side, view, (float(low), float(high)))) is not None:
            fits.append(fit)
    if len(fits) < CONFIG.fewest_slices:
        return None
    widest = max(fit[4] for fit in fits)
    along, across, slope, depth, half, *_ = np.median([fit for fit in fits if fit[4] >= CONFIG.widest * widest], axis=0)
    if (
        depth > CONFIG.round * half and abs(slope) < 1 - CONFIG.round
    ):  # a circle: its outline is measured better than its depth
        along, slope, depth = along + half - depth, 0.0, half
    axes, diameters, _ = np.linalg.svd(np.array([[depth, slope * half], [0.0, half]]))
    longer = np.stack([view.along, view.across], axis=1) @ axes[:, 0]
    x, y, _ = along * view.along + across * view.across
    yaw = float(np.arctan2(longer[1], longer[0]))
    return Ellipse((float(x), float(y)), (2 * float(diameters[0]), 2 * float(diameters[1])), yaw)


def _fit_half_ellipse(side: Array, view: View, heights: tuple[float, float]) -> Array | None:
    """The near half of an ellipse fitted to a slice, (N, 2) along and across the view; ``None`` where it is none.
    It is the middle along and across the view, slope, half depth and half width, metres."""
    fit = _fit_between_edges(side, _find_outline_edges(view, float(np.median(side[:, 0])), heights))
    # the outline's width depends on how far the axis is
    return None if fit is None else _fit_between_edges(side, _find_outline_edges(view, float(fit[0]), heights))


def _fit_between_edges(side: Array, edges: tuple[float, float] | None) -> Array | None:
    if edges is None:
        return None
    middle, half = (edges[0] + edges[1]) / 2, (edges[1] - edges[0]) / 2
    near = np.abs(side[:, 1] - middle) < CONFIG.seen * half
    if near.sum() < CONFIG.fewest:
        return None
    points = side[near]
    off = _solve_least_squares(points, middle, half)[1]
    points = points[off <= compute_percentiles(off, [90])]  # flying pixels
    solution, off = _solve_least_squares(points, middle, half)
    error = float(np.sqrt(np.mean(off**2)))
    flat = not CONFIG.depths[0] < solution[2] / half < CONFIG.depths[1]
    if flat or error > CONFIG.error * half or error > CONFIG.better * _rectangle_fit_error(points):
        return None
    return np.array([solution[0], middle, solution[1], solution[2], half])


def _solve_least_squares(points: Array, middle: float, half: float) -> tuple[Array, Array]:
    """Where the ellipse's middle lies along the view, its slope and half depth; and how far each point is off (m)."""
    across = points[:, 1] - middle
    terms = np.stack([np.ones(len(across)), across, -np.sqrt(1 - (across / half) ** 2)], axis=1)
    solution = np.asarray(np.linalg.lstsq(terms, points[:, 0], rcond=None)[0], np.float64)
    return solution, np.abs(points[:, 0] - terms @ solution)


def _find_outline_edges(view: View, axis: float, heights: tuple[float, float]) -> tuple[float, float] | None:
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


def _rectangle_fit_error(side: Array) -> float:
    """How far the points of a slice are off the nearest side of the rectangle that fits best: root mean square, m."""
    axes = axes_from_yaws(np.deg2rad(np.arange(-45.0, 45.0, 3.0)))
    flat = side @ axes.reshape(-1, 2).T
    low, high = compute_percentiles(flat, (2, 98))
    off = np.minimum(np.abs(flat - low), np.abs(flat - high))
    off = np.minimum(off[:, 0::2], off[:, 1::2])
    return float(np.sqrt((off**2).mean(axis=0)).min())
