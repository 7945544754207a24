"""Coverage: share of the raised pixels that objects own, and the regions without owner.

A pixel is raised if its point is higher than 6 to 10 mm (more from far away), lower than 0.6 m, and over the visible
part of the table or before it. Raised are also pixels that such pixels enclose, with lower or without depth, floors of
boxes and plates, and their feet, down to the measured noise of the table. The share counts measured pixels only.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from grs_agents.perception.annotated_pictures import draw_numbered_regions
from grs_agents.perception.configuration import DEFAULT
from grs_agents.perception.image_geometry import (
    compute_percentiles,
    label_connected_components,
    pixels_by_label,
    pixels_in_mask,
    share_of_borders,
)
from grs_agents.perception.segmentation.low_surfaces import find_enclosed_floors
from grs_agents.perception.segmentation.patch_cutting import foreground_pixel_mask, smooth_frame_depth
from grs_agents.perception.segmentation.segmentation import find_low_pieces, find_table_noise
from grs_agents.perception.table_finding import pixels_to_robot_frame, robot_frame_point_map
from grs_agents.perception.types import Aabb, Coverage, Mask, RGBDFrame, TableFrame, UnownedRegion
from grs_agents.perception.working_resolution import downscale_frame, downscale_mask, repeat_cells

CONFIG, SMALLEST = DEFAULT.coverage, DEFAULT.segmentation.filter.smallest
PICTURE = "scene/coverage.png"
KERNEL = np.ones((3, 3), np.uint8)
Rejected = tuple[Mask, str]
"""Pixels (H, W) of a segment that is no object, and the reason."""


@dataclass(frozen=True)
class MeasuredCoverage:
    """Coverage with its pixels."""

    share: float  # of the measured raised pixels; 1 without any
    above: Mask  # (H, W) raised pixels, and those of objects
    owned: Mask  # (H, W)
    regions: tuple[tuple[Mask, UnownedRegion], ...]  # (H, W) pixels of each unowned region, the largest first

    @property
    def record(self) -> Coverage:
        """The record for `scene.json`."""
        return Coverage(share=self.share, unowned=tuple(region for _, region in self.regions), picture=PICTURE)

    def write(self, frame: RGBDFrame, run: Path) -> Coverage:
        """Draw the photo with the unowned regions into the run folder. Returns: `record`."""
        draw_numbered_regions(frame, self.owned, [mask for mask, _ in self.regions], run / PICTURE)
        return self.record


def raised_pixel_mask(
    frame: RGBDFrame, table: TableFrame, left_out: Mask | None = None, robot: Mask | None = None
) -> Mask:
    """(H, W) raised pixels, without those ``left_out`` (H, W), such as the ``robot`` (H, W), and without their blurred
    edges."""
    small, factor = downscale_frame(frame)
    smooth = smooth_frame_depth(small)
    points = robot_frame_point_map(smooth, table)
    above = foreground_pixel_mask(points, smooth, np.asarray(table.T_robot_cam)[:3, 3])
    noise = max(CONFIG.lowest, CONFIG.deviations * table.residual)
    low = (points[..., 2] > noise) & (points[..., 2] < DEFAULT.segmentation.foreground.tallest)
    # Without noise of the table.
    bumps = label_connected_components(above.astype(np.uint8), 1)
    flat = find_low_pieces(bumps, points, table) | find_table_noise(bumps, points, small.rgb, table)
    above &= ~np.isin(bumps, list(flat))
    scenery, blurred = np.zeros(above.shape, np.bool_), np.zeros(frame.depth.shape, np.bool_)
    if left_out is not None:
        scenery = cv2.resize(left_out.astype(np.uint8), above.shape[::-1], interpolation=cv2.INTER_NEAREST) > 0
        blurred = np.asarray(cv2.dilate(left_out.astype(np.uint8), KERNEL, iterations=CONFIG.halo), np.bool_)
    clear = ~downscale_mask(blurred, factor)
    # Pixels without depth beside the robot are its shadow; low pixels between both and a plate's rim are its bottom.
    blind = smooth.depth <= 0
    above = _fill_enclosed_pixels(above & ~scenery, low | blind)
    above |= _fill_enclosed_pixels(above | scenery | blind, low) & low & ~scenery
    floors = find_enclosed_floors(above, points[..., 2], ~scenery & ~blind, small, table)
    # A floor enclosed by the robot's blurred edge alone is table.
    beside, blurred_beside = (share_of_borders(floors, above & pixels) for pixels in (clear, ~clear))
    floors[((beside == 0) & (blurred_beside > 0))[floors]] = 0
    above |= floors > 0
    feet = above & clear  # not of the blur beside the robot
    for _ in range(CONFIG.foot):
        feet = feet | (np.asarray(cv2.dilate(feet.astype(np.uint8), KERNEL), np.bool_) & low & ~scenery)
    above |= feet
    # A floor counts as a whole if its height is measured beside the blur.
    sure = np.zeros(floors.shape, np.bool_)
    for pixels in pixels_by_label(floors):
        beside_blur = pixels[clear.take(pixels)]
        enough = len(beside_blur) > DEFAULT.segmentation.floors.pixels * floors.size
        if enough and np.nanmedian(points[..., 2].take(beside_blur)) > DEFAULT.segmentation.floors.floor:
            sure.put(pixels, True)
    if left_out is not None and robot is not None:
        # Pixels above CONFIG.high count in the blurred margin of the robot, too, except right at it.
        at_robot, others = (cv2.dilate(mask.astype(np.uint8), KERNEL) > 0 for mask in (robot, left_out & ~robot))
        halo = np.asarray(cv2.dilate(others.astype(np.uint8), KERNEL, iterations=CONFIG.halo - 1), np.bool_)
        sure |= (points[..., 2] > CONFIG.high) & downscale_mask(~at_robot & ~halo, factor)
    return repeat_cells(above, frame, factor) & (~blurred | repeat_cells(sure, frame, factor))


def _fill_enclosed_pixels(above: Mask, maybe: Mask) -> Mask:
    """``above`` (H, W) with the pieces of ``maybe`` that it encloses: bottoms of plates, shiny sides without depth."""
    pieces = label_connected_components((maybe & ~above).astype(np.uint8), 1)
    filled = share_of_borders(pieces, above) > CONFIG.enclosed
    return above | filled[pieces] & (pieces > 0)


def measure_coverage(
    frame: RGBDFrame, table: TableFrame, above: Mask, owned: Mask, rejected: Sequence[Rejected] = ()
) -> MeasuredCoverage:
    """The share of the measured raised pixels that objects own, and the unowned regions.

    Args:
        frame: the photo.
        table: the table in it.
        above: (H, W) raised pixels of `raised_pixel_mask`; pixels of objects are added.
        owned: (H, W) pixels of all objects.
        rejected: segments that are no objects, as reasons for unowned regions.
    """
    above, measured = above | owned, frame.depth > 0
    total, counted = max(np.count_nonzero(above), 1), max(np.count_nonzero(above & measured), 1)
    unowned = above & ~owned
    labels = label_connected_components(unowned.astype(np.uint8), int(CONFIG.listed * total))
    regions: list[tuple[Mask, UnownedRegion]] = []
    for pixels in sorted(pixels_by_label(labels), key=len, reverse=True):
        mask = np.zeros(unowned.shape, np.bool_)
        mask.put(pixels, True)
        near = mask  # of the measured points; without any, of those around
        if not (mask & measured).any():
            near = np.asarray(cv2.dilate(mask.astype(np.uint8), KERNEL, iterations=CONFIG.thin), np.bool_)
        points = pixels_to_robot_frame(frame, table, *pixels_in_mask(near & measured))
        if len(points):
            low, high = compute_percentiles(points, (1, 99)).round(4).tolist()
            box = Aabb(low=(low[0], low[1], low[2]), high=(high[0], high[1], high[2]))
            reason = _explain_unowned_region(mask, frame, rejected)
            regions.append((mask, UnownedRegion(share=len(pixels) / total, box=box, reason=reason)))
    return MeasuredCoverage(1 - np.count_nonzero(unowned & measured) / counted, above, owned, tuple(regions))


def _explain_unowned_region(mask: Mask, frame: RGBDFrame, rejected: Sequence[Rejected]) -> str:
    """Reason that no object owns a region (H, W)."""
    count = int(np.count_nonzero(mask))
    for segment, reason in rejected:
        if np.count_nonzero(segment & mask) > CONFIG.most * count:
            return f"dropped: {reason}"
    if np.count_nonzero(mask & (frame.depth <= 0)) > CONFIG.most * count:
        return "no depth"
    core = cv2.erode(mask.astype(np.uint8), np.ones((CONFIG.thin, CONFIG.thin), np.uint8))
    if count < SMALLEST * mask.size or not core.any():
        return "too small or thin for an object"
    return "not segmented"


def describe_coverage(coverage: Coverage) -> str:
    """The share, and the largest unowned regions, in words."""
    parts = [
        f"{region.share:.0%} at x = {region.box.center[0]:.2f}, y = {region.box.center[1]:.2f} m ({region.reason})"
        for region in coverage.unowned[: CONFIG.named]
    ]
    missed = f": {1 - coverage.share:.0%} of what rises above the table belongs to no object, {', '.join(parts)}"
    return f"coverage {coverage.share:.2f}" + (missed if parts else "")
