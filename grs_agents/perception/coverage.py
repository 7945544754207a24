"""Which part of what rises above the table the objects own, and what lies where no object does.

A pixel rises above the table if its point is higher than 6 to 10 mm (more from far away), lower than 0.6 m, and over
the visible part of the table or before it. So does what such pixels enclose, whether it is lower or has no depth, the
floors of boxes and plates, and their feet, down to the measured noise of the table. The share is that of the measured
ones: nobody knows what is where nothing was measured.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from grs_agents.perception.annotated_pictures import draw_numbered_regions
from grs_agents.perception.configuration import DEFAULT
from grs_agents.perception.image_geometry import (
    Labels,
    compute_percentiles,
    label_connected_components,
    pixels_by_label,
    pixels_in_mask,
    share_of_borders,
)
from grs_agents.perception.segmentation.enclosed_floors import find_enclosed_floors
from grs_agents.perception.segmentation.low_things import find_low_things
from grs_agents.perception.segmentation.patch_cutting import foreground_pixel_mask, smooth_frame_depth
from grs_agents.perception.segmentation.segmentation import is_sensor_noise
from grs_agents.perception.table_finding import pixels_to_robot_frame, robot_frame_point_map
from grs_agents.perception.types import Aabb, Array, Coverage, Mask, RGBDFrame, TableFrame, UnownedRegion
from grs_agents.perception.working_resolution import downscale_frame, downscale_mask, repeat_cells

CONFIG, SMALLEST = DEFAULT.coverage, DEFAULT.segmentation.filter.smallest
PICTURE = "scene/coverage.png"
KERNEL = np.ones((3, 3), np.uint8)
Rejected = tuple[Mask, str]
"""The pixels (H, W) of a segment that is no object, and why it is none."""


@dataclass(frozen=True)
class MeasuredCoverage:
    """How much the objects own, with the pixels."""

    share: float  # of the measured pixels that rise above the table; 1 where none does
    above: Mask  # (H, W) what rises above the table, or belongs to an object
    owned: Mask  # (H, W)
    regions: tuple[tuple[Mask, UnownedRegion], ...]  # (H, W) pixels of what no object owns, the largest first

    def write(self, frame: RGBDFrame, run: Path) -> Coverage:
        """Draw the photo with what no object owns into the run folder; what `scene.json` tells of it."""
        draw_numbered_regions(frame, self.owned, [mask for mask, _ in self.regions], run / PICTURE)
        return Coverage(share=self.share, unowned=tuple(region for _, region in self.regions), picture=PICTURE)


def raised_pixel_mask(
    frame: RGBDFrame, table: TableFrame, left_out: Mask | None = None, robot: Mask | None = None
) -> Mask:
    """(H, W) the pixels that rise above the table, but for those ``left_out`` (H, W), the ``robot`` (H, W) and walls of
    a bin, and for their blurred edges."""
    small, factor = downscale_frame(frame)
    smooth = smooth_frame_depth(small)
    points = robot_frame_point_map(smooth, table)
    above = foreground_pixel_mask(points, smooth.depth, np.asarray(table.T_robot_cam)[:3, 3])
    noise = max(CONFIG.lowest, CONFIG.deviations * table.residual)
    low = (points[..., 2] > noise) & (points[..., 2] < DEFAULT.segmentation.foreground.tallest)
    above = _drop_sensor_noise(above, points[..., 2], table)
    scenery, blurred = np.zeros(above.shape, np.bool_), np.zeros(frame.depth.shape, np.bool_)
    if left_out is not None:
        scenery = cv2.resize(left_out.astype(np.uint8), above.shape[::-1], interpolation=cv2.INTER_NEAREST) > 0
        blurred = np.asarray(cv2.dilate(left_out.astype(np.uint8), KERNEL, iterations=CONFIG.halo), np.bool_)
    clear = ~downscale_mask(blurred, factor)
    # What has no depth beside the robot is its shadow; what is low between both and a plate's rim is a plate's bottom.
    blind = smooth.depth <= 0
    above = _fill_enclosed_pixels(above & ~scenery, low | blind)
    above |= _fill_enclosed_pixels(above | scenery | blind, low) & low & ~scenery
    floors = find_enclosed_floors(above, points[..., 2], ~scenery & ~blind, small, table)
    # What the robot's blurred edge rises beside, and nothing else, is table.
    beside, blurred_beside = (share_of_borders(floors, above & pixels) for pixels in (clear, ~clear))
    floors[((beside == 0) & (blurred_beside > 0))[floors]] = 0
    above |= floors > 0
    above |= find_low_things(small, table, above | scenery) > 0
    feet = above & clear  # what is blurred beside the robot has none
    for _ in range(CONFIG.foot):
        feet = feet | (np.asarray(cv2.dilate(feet.astype(np.uint8), KERNEL), np.bool_) & low & ~scenery)
    above |= feet
    # A floor has one height: where that is measured beside the blur, all of it counts.
    sure = _floors_measured_at(clear, floors, points[..., 2])
    if left_out is not None and robot is not None:
        sure |= (points[..., 2] > CONFIG.high) & downscale_mask(_only_beside_robot(left_out, robot), factor)
    return repeat_cells(above, frame, factor) & (~blurred | repeat_cells(sure, frame, factor))


def _only_beside_robot(left_out: Mask, robot: Mask) -> Mask:
    """(H, W) what the robot may blur, but no other of what was left out, apart from the pixels at it."""
    own, others = (cv2.dilate(mask.astype(np.uint8), KERNEL) > 0 for mask in (robot, left_out & ~robot))
    return ~own & ~np.asarray(cv2.dilate(others.astype(np.uint8), KERNEL, iterations=CONFIG.halo - 1), np.bool_)


def _floors_measured_at(clear: Mask, floors: Labels, height: Array) -> Mask:
    """(H, W) the ``floors`` (H, W), from 1, that lie over the table where it is ``clear`` (H, W)."""
    bounds = DEFAULT.segmentation.floors
    found = np.zeros(floors.shape, np.bool_)
    for pixels in pixels_by_label(floors):
        own = pixels[clear.take(pixels)]
        if len(own) > bounds.pixels * floors.size and np.nanmedian(height.take(own)) > bounds.floor:
            found.put(pixels, True)
    return found


def _drop_sensor_noise(above: Mask, height: Array, table: TableFrame) -> Mask:
    """``above`` (H, W) without the bumps of the sensor's noise on the table."""
    bounds = DEFAULT.segmentation.filter
    flattest = float(np.clip(bounds.deviations * table.residual, *bounds.flattest))
    smallest = int(bounds.smallest * above.size)
    labels = label_connected_components(above.astype(np.uint8), 1)
    heights = (height.take(pixels) for pixels in pixels_by_label(labels))
    kept = [False, *(not is_sensor_noise(own, 4 * smallest, flattest) for own in heights)]
    return np.asarray(kept, np.bool_)[labels]


def _fill_enclosed_pixels(above: Mask, maybe: Mask) -> Mask:
    """``above`` (H, W) with the pieces of ``maybe`` that it encloses: a plate's bottom, a shiny side without depth."""
    pieces = label_connected_components((maybe & ~above).astype(np.uint8), 1)
    filled = share_of_borders(pieces, above) > CONFIG.enclosed
    return above | filled[pieces] & (pieces > 0)


def measure_coverage(
    frame: RGBDFrame, table: TableFrame, above: Mask, owned: Mask, rejected: Sequence[Rejected] = ()
) -> MeasuredCoverage:
    """The share of what rises above the table, and was measured, that objects own.

    Args:
        frame: the photo.
        table: the table in it.
        above: (H, W) what rises, as `raised_pixel_mask` finds it; what objects own rises too.
        owned: (H, W) the pixels of all objects.
        rejected: segments that are no objects: they say why no object owns their pixels.
    """
    above, measured = above | owned, frame.depth > 0
    total, counted = max(np.count_nonzero(above), 1), max(np.count_nonzero(above & measured), 1)
    unowned = above & ~owned
    labels = label_connected_components(unowned.astype(np.uint8), int(CONFIG.listed * total))
    regions: list[tuple[Mask, UnownedRegion]] = []
    for pixels in sorted(pixels_by_label(labels), key=len, reverse=True):
        mask = np.zeros(unowned.shape, np.bool_)
        mask.put(pixels, True)
        box = _box_of_pixels(frame, table, mask)
        if box is not None:
            reason = _explain_unowned_region(mask, frame, rejected)
            regions.append((mask, UnownedRegion(share=len(pixels) / total, box=box, reason=reason)))
    return MeasuredCoverage(1 - np.count_nonzero(unowned & measured) / counted, above, owned, tuple(regions))


def _box_of_pixels(frame: RGBDFrame, table: TableFrame, mask: Mask) -> Aabb | None:
    """The box of the measured points of a mask (H, W), without any of those around it; None where there are none."""
    measured = frame.depth > 0
    if not (mask & measured).any():
        mask = np.asarray(cv2.dilate(mask.astype(np.uint8), KERNEL, iterations=CONFIG.thin), np.bool_)
    points = pixels_to_robot_frame(frame, table, *pixels_in_mask(mask & measured))
    if not len(points):
        return None
    low, high = compute_percentiles(points, (1, 99)).round(4).tolist()
    return Aabb(low=(low[0], low[1], low[2]), high=(high[0], high[1], high[2]))


def _explain_unowned_region(mask: Mask, frame: RGBDFrame, rejected: Sequence[Rejected]) -> str:
    """Why no object owns a region (H, W)."""
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
    """The share, and the largest regions that it leaves out, in words."""
    parts = [
        f"{region.share:.0%} at x = {region.box.center[0]:.2f}, y = {region.box.center[1]:.2f} m ({region.reason})"
        for region in coverage.unowned[: CONFIG.named]
    ]
    missed = f": {1 - coverage.share:.0%} of what rises above the table belongs to no object, {', '.join(parts)}"
    return f"coverage {coverage.share:.2f}" + (missed if parts else "")
