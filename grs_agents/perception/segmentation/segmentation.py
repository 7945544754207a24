"""Segmentation of the objects on the table: smooth patches of the foreground, merged to objects and filtered."""

import cv2
import numpy as np

from grs_agents.perception.configuration import DEFAULT
from grs_agents.perception.image_geometry import (
    Labels,
    convex_footprint_hull,
    convex_outline_mask,
    mask_bounding_slices,
    pixels_by_label,
    points_in_hull_mask,
    values_in_mask,
)
from grs_agents.perception.segmentation.configuration import Segmentation
from grs_agents.perception.segmentation.footprints import is_open_at_top
from grs_agents.perception.segmentation.low_surfaces import add_enclosed_floors, find_enclosed_floors
from grs_agents.perception.segmentation.part_merging import merge_parts
from grs_agents.perception.segmentation.patch_cutting import (
    cut_smooth_patches,
    foreground_pixel_mask,
    smooth_frame_depth,
)
from grs_agents.perception.segmentation.piece_joining import join_occluded_pieces, join_plain_pieces
from grs_agents.perception.table_finding import robot_frame_point_map
from grs_agents.perception.types import Array, Camera, Mask, RGBDFrame, TableFrame
from grs_agents.perception.working_resolution import downscale_frame, upscale_labels


def segment_objects_on_table(
    frame: RGBDFrame, table: TableFrame, config: Segmentation = DEFAULT.segmentation
) -> Labels:
    """(H, W) labels: 0 for table and background, 1..N for the segments."""
    small, factor = downscale_frame(frame)
    smooth = smooth_frame_depth(small)
    points = robot_frame_point_map(smooth, table)
    above = foreground_pixel_mask(points, smooth.depth, np.asarray(table.T_robot_cam)[:3, 3], config.foreground)
    labels = merge_parts(cut_smooth_patches(smooth, above, config.patches), points, small.rgb, config)
    labels = filter_object_segments(labels, smooth, points, table, config)
    if "plain_color" in config.rules:
        labels = join_plain_pieces(labels, smooth, config)
    if "hollow_floor" in config.rules:
        floors = find_enclosed_floors(labels > 0, points[..., 2], smooth.depth > 0, small, table, config.floors)
        labels = add_enclosed_floors(labels, floors, config.floors)
    return labels if factor == 1 else upscale_labels(labels, small, frame, factor)


def filter_object_segments(
    labels: Labels, smooth: RGBDFrame, points: Array, table: TableFrame, config: Segmentation = DEFAULT.segmentation
) -> Labels:
    """(H, W) labels of the segments that are objects, renumbered; occluded pieces joined, floors added.
    ``smooth`` is the frame of the merged segments; ``points`` are (H, W, 3) in the robot frame, NaN where unknown."""
    smallest = int(config.filter.smallest * labels.size)
    flattest = float(np.clip(config.filter.deviations * table.residual, *config.filter.flattest))
    segments = pixels_by_label(labels)
    heights = [points[..., 2].take(pixels) for pixels in segments]
    kept = [label for label, own in enumerate(heights, 1) if len(own) >= smallest]
    if "sensor_noise" in config.rules:
        kept = [label for label in kept if not is_sensor_noise(heights[label - 1], 4 * smallest, flattest)]
    if "flying_pixels" in config.rules:
        square, values = np.ones((2 * config.filter.band + 1,) * 2, np.uint8), labels.astype(np.float32)
        inner = np.where(cv2.dilate(values, square) == cv2.erode(values, square), labels, 0)
        counts = np.bincount(inner.ravel(), minlength=len(segments) + 1)
        slivers: set[int] = set()
        for label in kept:
            pixels, depth = segments[label - 1], smooth.depth.take(segments[label - 1])
            if len(pixels) > config.filter.sliver * labels.size or not (depth > 0).any():
                continue
            low, middle, high = np.percentile(depth[depth > 0], (5, 50, 95))
            is_deep = high - low > config.filter.flying * np.sqrt(len(pixels)) * middle / smooth.camera.fx
            if is_deep or counts[label] < config.filter.inner * len(pixels):
                slivers.add(label)
        kept = [label for label in kept if label not in slivers]
    numbers = np.zeros(len(heights) + 1, np.int32)
    numbers[kept] = np.arange(1, len(kept) + 1)
    labels = numbers[labels]
    if "occluded" in config.rules:
        labels = join_occluded_pieces(labels, smooth, points, config.occluded)
    if "hollow_floor" not in config.rules:
        return labels
    # The table that is seen inside a hollow object is its floor.
    result = labels.copy()
    flat = (labels == 0) & (np.abs(points[..., 2]) < config.filter.floor)
    for label in range(1, int(labels.max()) + 1):
        window = mask_bounding_slices(labels == label)
        mask: Mask = labels[window] == label
        near, filled = points[window], result[window]
        lies = flat[window] & convex_outline_mask(mask)
        floor, cloud = values_in_mask(near, lies), values_in_mask(near, mask)[::3]
        cloud = cloud.compress(np.isfinite(cloud[:, 2]), axis=0)
        if len(cloud) >= 3 and is_open_at_top(cloud, floor[::3], config.hollow):
            inside = points_in_hull_mask(floor[:, :2], convex_footprint_hull(cloud), -config.filter.floor_margin)
            filled[lies] = np.where(inside, label, filled[lies])
    return result


def is_segment_entering_view(mask: Mask, points: Array, camera: Camera, config: Segmentation) -> bool:
    """Whether a segment (H, W) enters from above or from beyond the picture; ``points`` (H, W, 3), robot frame."""
    bounds = config.filter
    whole = _drop_unknown_points(points[mask][::5])
    if len(whole) < bounds.fewest:
        return False
    lowest, highest = np.percentile(whole[:, 2], (2, bounds.top_beside_arm if camera.arm_is_known else 99))
    if highest > config.foreground.tallest - bounds.round:
        return True
    sides = np.ones_like(mask)
    sides[bounds.border :, bounds.border : -bounds.border] = False
    in_the_air = lowest > bounds.clear
    if in_the_air and not camera.arm_is_known and len(_drop_unknown_points(points[mask & sides])) >= bounds.fewest:
        return True  # its foot may lie below the picture, or be hidden
    if camera.arm_is_known and not in_the_air:
        return False  # the only arm that reaches down to the table is known
    sides[-bounds.border :] = True
    cut = _drop_unknown_points(points[mask & sides])
    if len(cut) < bounds.fewest:
        return False
    low, high = np.percentile(cut[:, 2], (5, 95))
    reach = np.linalg.norm(whole[:, :2] - np.median(cut[:, :2], axis=0), axis=1)
    return bool(low > bounds.clear and high - low > bounds.round and np.percentile(reach, 98) > bounds.long)


def _drop_unknown_points(points: Array) -> Array:
    return points[np.isfinite(points[:, 2])]


def is_sensor_noise(heights: Array, small: int, flattest: float) -> bool:
    """Whether a segment, (N,) heights in m, is sensor noise on the table."""
    top = float(np.nanpercentile(heights, 95))
    return top < flattest or (top < 2 * flattest and len(heights) < small)
