"""Segmentation of the objects on the table: smooth patches of the foreground, merged to objects and filtered."""

import cv2
import numpy as np

from grs_agents.perception.configuration import DEFAULT
from grs_agents.perception.image_geometry import (
    Labels,
    convex_footprint_hull,
    convex_outline_mask,
    grow_window,
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
    compute_concavity_map,
    cut_smooth_patches,
    foreground_pixel_mask,
    smooth_frame_depth,
)
from grs_agents.perception.segmentation.piece_colors import color_bins, color_histogram, lab_colors
from grs_agents.perception.segmentation.piece_joining import (
    join_alike_pieces,
    join_occluded_pieces,
    join_plain_pieces,
    join_steep_pieces,
)
from grs_agents.perception.table_finding import robot_frame_point_map
from grs_agents.perception.types import Array, Camera, Image, Mask, RGBDFrame, TableFrame
from grs_agents.perception.working_resolution import downscale_frame, upscale_labels


def segment_objects_on_table(
    frame: RGBDFrame, table: TableFrame, config: Segmentation = DEFAULT.segmentation
) -> Labels:
    """(H, W) labels: 0 for table and background, 1..N for the segments."""
    small, factor = downscale_frame(frame)
    smooth = smooth_frame_depth(small)
    points = robot_frame_point_map(smooth, table)
    above = foreground_pixel_mask(points, smooth, np.asarray(table.T_robot_cam)[:3, 3], config.foreground)
    bend = compute_concavity_map(smooth, above, config.patches)
    labels = merge_parts(cut_smooth_patches(smooth, above, bend, config.patches), points, small.rgb, config)
    labels = filter_object_segments(labels, smooth, points, table, config)
    if "steep" in config.rules:
        labels = join_steep_pieces(labels, smooth, config)
    if "alike" in config.rules:
        labels = join_alike_pieces(labels, smooth, bend, config)
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
    segments = pixels_by_label(labels)
    kept = [label for label, own in enumerate(segments, 1) if len(own) >= smallest]
    if "sensor_noise" in config.rules:
        noise = find_table_noise(labels, points, smooth.rgb, table, config)
        kept = [label for label in kept if label not in noise]
    if "flying_pixels" in config.rules:
        inner, slivers = share_off_edges(labels, config), set[int]()
        for label in kept:
            pixels, depth = segments[label - 1], smooth.depth.take(segments[label - 1])
            if len(pixels) > config.filter.sliver * labels.size or not (depth > 0).any():
                continue
            low, middle, high = np.percentile(depth[depth > 0], (5, 50, 95))
            is_deep = high - low > config.filter.flying * np.sqrt(len(pixels)) * middle / smooth.camera.fx
            if is_deep or inner[label] < config.filter.inner:
                slivers.add(label)
        kept = [label for label in kept if label not in slivers]
    numbers = np.zeros(len(segments) + 1, np.int32)
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


def is_segment_entering_view(
    mask: Mask, points: Array, borders: tuple[Mask, Mask], camera: Camera, config: Segmentation
) -> bool:
    """Whether a segment (H, W) enters from above or from beyond the view.

    ``points`` are (H, W, 3), robot frame; ``borders`` are those of `find_view_border`."""
    bounds = config.filter
    whole = _drop_unknown_points(points[mask][::5])
    if len(whole) < bounds.fewest:
        return False
    lowest, highest = np.percentile(whole[:, 2], (2, bounds.top_beside_arm if camera.arm_is_known else 99))
    if highest > config.foreground.tallest - bounds.round:
        return True
    sides, bottom = (_drop_unknown_points(points[mask & border]) for border in borders)
    cut = np.concatenate([sides, bottom])
    if len(cut) < bounds.fewest:
        return False
    if lowest > bounds.clear:  # in the air: its foot may lie beyond the view, or be hidden
        if len(sides) > len(bottom) and not camera.arm_is_known:
            return True
    elif camera.arm_is_known:
        return False  # the only arm that reaches down to the table is known
    low, high = np.percentile(cut[:, 2], (5, 95))
    reach = np.linalg.norm(whole[:, :2] - np.median(cut[:, :2], axis=0), axis=1)
    return bool(low > bounds.clear and high - low > bounds.round and np.percentile(reach, 98) > bounds.long)


def find_view_border(points: Array, config: Segmentation = DEFAULT.segmentation) -> tuple[Mask, Mask]:
    """(H, W) pixels at the upper and lateral borders, and at the lower border, of the view in which depth is measured.

    Of a depth camera beside the colour camera it is a little less than the picture. ``points`` are (H, W, 3), NaN where
    unknown."""
    known, bounds = np.isfinite(points[..., 2]), config.filter
    numbers = np.indices(known.shape)
    borders: list[Mask] = []
    for axis, way in ((0, 1), (1, 1), (1, -1), (0, -1)):
        size = known.shape[axis]
        first = np.expand_dims(np.flip(known, axis).argmax(axis) if way < 0 else known.argmax(axis), axis)
        first = np.where(first < bounds.unmeasured * size, first, 0)  # farther, the background is unmeasured
        place = numbers[axis] if way > 0 else size - 1 - numbers[axis]
        borders.append(place < first + bounds.border)
    return borders[0] | borders[1] | borders[2], borders[3]


def _drop_unknown_points(points: Array) -> Array:
    return points[np.isfinite(points[:, 2])]


def share_off_edges(labels: Labels, config: Segmentation = DEFAULT.segmentation) -> Array:
    """(N + 1,) share of the pixels of labels 0..N, (H, W), that are off the edges, where depth is mixed."""
    square, values = np.ones((2 * config.filter.band + 1,) * 2, np.uint8), labels.astype(np.float32)
    inner = np.where(cv2.dilate(values, square) == cv2.erode(values, square), labels, 0)
    count = int(labels.max()) + 1
    return np.bincount(inner.ravel(), minlength=count) / np.maximum(np.bincount(labels.ravel(), minlength=count), 1)


def find_low_pieces(
    labels: Labels, points: Array, table: TableFrame, config: Segmentation = DEFAULT.segmentation
) -> frozenset[int]:
    """The pieces, of (H, W) labels from 1, that are no higher than the table's noise. ``points`` are (H, W, 3) in the
    robot frame, NaN where unknown."""
    bounds, found = config.filter, set[int]()
    flattest = float(np.clip(bounds.deviations * table.residual, *bounds.flattest))
    for label, pixels in enumerate(pixels_by_label(labels), 1):
        heights = points[..., 2].take(pixels)
        top = float(np.nanpercentile(heights, 95)) if np.isfinite(heights).any() else 0.0
        if top < flattest or (top < 2 * flattest and len(pixels) < 4 * int(bounds.smallest * labels.size)):
            found.add(label)
    return frozenset(found)


def find_table_noise(
    labels: Labels, points: Array, rgb: Image, table: TableFrame, config: Segmentation = DEFAULT.segmentation
) -> frozenset[int]:
    """The pieces, of (H, W) labels from 1, that are sensor noise, or mixed depth at the edge of an object.

    They are narrow and look like the table around them, or as low as its noise, unless they lie free and look neither
    like it nor like a neighbour, as a pen does.

    Args:
        labels: of the pieces.
        points: (H, W, 3) in the robot frame, NaN where unknown.
        rgb: (H, W, 3) the photo.
        table: the table in it.
        config: bounds on their height, size and colours.
    """
    bounds, found = config.filter, set[int]()
    low, inner = find_low_pieces(labels, points, table, config), share_off_edges(labels, config)
    flat = (labels == 0) & (np.abs(points[..., 2]) < bounds.floor)
    square = np.ones((2 * bounds.around + 1,) * 2, np.uint8)
    for label, pixels in enumerate(pixels_by_label(labels), 1):
        if len(pixels) < bounds.smallest * labels.size or (label not in low and inner[label] > bounds.mixed):
            continue
        rows, columns = divmod(pixels, labels.shape[1])
        window = grow_window(np.s_[rows.min() : rows.max() + 1, columns.min() : columns.max() + 1], bounds.around)
        near, shades = labels[window], color_bins(lab_colors(rgb[window]))
        ring = cv2.dilate((near == label).astype(np.uint8), square) > 0
        looks = [ring & flat[window]]
        if label in low:  # of a neighbour it may be the foot
            if 2 * np.count_nonzero(looks[0]) < np.count_nonzero(ring & (near != label)):
                found.add(label)
            looks += [near == neighbor for neighbor in np.unique(near[ring]).tolist() if neighbor not in (0, label)]
        own = color_histogram(shades[near == label])
        if any(float(own @ color_histogram(shades[look])) > bounds.alike for look in looks if look.any()):
            found.add(label)
    return frozenset(found)
