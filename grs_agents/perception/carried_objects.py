"""Objects that stand on a plane: compact clusters of points above its visible part, with free plane around them.

They tell a table from a wall, a door or a floor: neighbouring walls and furniture are wide, tall or in the air.
"""

from dataclasses import dataclass

import cv2
import numpy as np

from grs_agents.perception.configuration import DEFAULT
from grs_agents.perception.image_geometry import (
    compute_percentiles,
    convex_footprint_hull,
    label_connected_components,
    pixels_by_label,
    points_in_hull_mask,
)
from grs_agents.perception.plane_fitting import Plane, depth_tolerance
from grs_agents.perception.types import Array, Mask, RGBDFrame

CONFIG = DEFAULT.carried


@dataclass(frozen=True)
class PointGrid:
    """A regular subset of a photo's points."""

    points: Array  # (h, w, 3) camera frame, m; (0, 0, 0) without depth
    jumps: Mask  # (h, w) points on either side of a depth jump

    @property
    def known(self) -> Mask:
        """(h, w) measured points."""
        return self.points[..., 2] > 0


def make_point_grid(frame: RGBDFrame) -> PointGrid:
    """Every n-th point of each n-th row of a frame, about `CarriedObjects.points` in all."""
    step = max(1, int(np.ceil((frame.depth.size / CONFIG.points) ** 0.5)))
    camera, depth = frame.camera, frame.depth[::step, ::step].astype(np.float64)
    rows, columns = np.indices(depth.shape) * step
    points = np.stack([(columns - camera.cx) / camera.fx * depth, (rows - camera.cy) / camera.fy * depth, depth], -1)
    jumps, bound = np.zeros(depth.shape, np.bool_), CONFIG.jump * (2 + depth)
    for first, second in ((np.s_[:-1], np.s_[1:]), (np.s_[:, :-1], np.s_[:, 1:])):
        jump = np.abs(depth[first] - depth[second]) > bound[second]
        jumps[first] |= jump
        jumps[second] |= jump
    return PointGrid(points, jumps)


def measure_carried_share(plane: Plane, grid: PointGrid) -> float:
    """Share of the measured points of a grid on objects that stand on a plane.

    A cluster is an object if most of it is over the visible part of the plane or occludes it, if its foot is near the
    plane and the plane is visible around it, and if it is neither too large for the arm nor too flat to be resolved."""
    known, tolerance = grid.known, depth_tolerance(grid.points[..., 2])
    heights = np.where(known, plane.heights_of_points(grid.points), -np.inf)
    flat = np.abs(heights) < tolerance
    inner = cv2.erode(flat.astype(np.uint8), np.ones((3, 3), np.uint8))
    pieces = pixels_by_label(label_connected_components(inner, CONFIG.fewest))
    if not pieces:
        return 0.0
    largest = max(map(len, pieces))
    visible = np.concatenate([piece for piece in pieces if len(piece) >= CONFIG.piece * largest])
    across = np.linalg.svd(plane.normal[None])[2][1:].T
    footprints = (grid.points @ across).reshape(-1, 2)
    hull = convex_footprint_hull(footprints.take(visible, axis=0))
    raised = (heights > np.maximum(tolerance, CONFIG.lowest)) & ~grid.jumps
    labels = label_connected_components(raised.astype(np.uint8), CONFIG.fewest)
    count = 0
    for label, pixels in enumerate(pixels_by_label(labels), 1):
        footprint, height = footprints.take(pixels, axis=0), heights.take(pixels)
        bottom, top = compute_percentiles(height, (3, 97))
        if np.median(grid.points[..., 2].take(pixels)) > CONFIG.farthest:
            continue
        if top < CONFIG.resolved * float(np.median(tolerance.take(pixels))) or top > DEFAULT.measuring.largest:
            continue
        radii = np.linalg.norm(footprint - np.median(footprint, axis=0), axis=1)
        if bottom > CONFIG.foot or compute_percentiles(radii, (95,))[0] > CONFIG.widest:
            continue
        # The rays through the points meet the plane farther away.
        shadow = footprint * (plane.offset / np.maximum(plane.offset - height, 1e-6))[:, None]
        if max(points_in_hull_mask(place, hull, 0.0).mean() for place in (footprint, shadow)) < 0.5:
            continue
        cluster = labels == label
        around = (cv2.dilate(cluster.astype(np.uint8), np.ones((CONFIG.ring,) * 2, np.uint8)) > 0) & ~cluster & known
        if np.count_nonzero(flat & around) > CONFIG.free * np.count_nonzero(around):
            count += len(pixels)
    return count / max(np.count_nonzero(known), 1)
