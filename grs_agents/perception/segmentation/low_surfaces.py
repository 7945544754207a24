"""Surfaces below the noise of a pixel: low things free on the table, such as pens, and floors enclosed by walls.

Averages over many pixels reveal them: a low thing rises above the table right around it, and a floor of a box, tray or
plate above the table plane.
"""

import cv2
import numpy as np
import numpy.typing as npt

from grs_agents.perception.configuration import DEFAULT
from grs_agents.perception.depth_quality import NORMAL
from grs_agents.perception.image_geometry import (
    Labels,
    label_connected_components,
    pixels_by_label,
    points_in_hull_mask,
    share_of_borders,
)
from grs_agents.perception.segmentation.configuration import EnclosedFloors, LowThings
from grs_agents.perception.segmentation.patch_cutting import find_table_hull
from grs_agents.perception.table_finding import robot_frame_point_map
from grs_agents.perception.types import Array, Mask, RGBDFrame, TableFrame


def find_low_things(
    frame: RGBDFrame, table: TableFrame, taken: Mask, config: LowThings = DEFAULT.segmentation.low
) -> Labels:
    """(H, W) labels of the low things, from 1.

    Args:
        frame: the photo as it was measured, at its working size.
        table: the table in it.
        taken: (H, W) pixels known to rise, or to be no table.
    """
    points = robot_frame_point_map(frame, table)
    height = points[..., 2]
    wide = np.ones((config.gap,) * 2, np.uint8)
    unknown = cv2.morphologyEx(np.isnan(height).astype(np.uint8), cv2.MORPH_OPEN, wide) > 0
    near = cv2.dilate((taken | unknown).astype(np.uint8), np.ones((2 * config.apart + 1,) * 2, np.uint8)) > 0
    flat = (np.abs(height) < config.highest) & ~near
    found = np.zeros(height.shape, np.int32)
    if not flat.any():
        return found

    def average(width: int) -> npt.NDArray[np.float32]:
        """(H, W) average height of the flat pixels in a window of ``width`` pixels, m."""
        known = np.asarray(cv2.blur(flat.astype(np.float32), (width, width)), np.float32)
        total = cv2.blur(np.where(flat, height, 0).astype(np.float32), (width, width))
        return np.asarray(total / np.maximum(known, 1e-6), np.float32)

    relief = average(config.fine) - average(config.coarse)
    deviation = float(np.median(np.abs(relief[flat]))) / NORMAL
    raised = (flat & (relief > max(config.lowest, config.deviations * deviation))).astype(np.uint8)
    hull: Array | None = None
    for pixels in pixels_by_label(label_connected_components(raised, int(config.smallest * height.size))):
        piece = np.zeros(height.shape, np.uint8)
        piece.put(pixels, 1)
        ring = (cv2.dilate(piece, np.ones((2 * config.ring + 1,) * 2, np.uint8)) > 0) & (raised == 0)
        if ring[0].any() or ring[-1].any() or ring[:, 0].any() or ring[:, -1].any():
            continue  # cut by the border: its surroundings are unknown
        if np.count_nonzero(flat & ring) <= config.free * np.count_nonzero(ring):
            continue
        if hull is None:
            hull = find_table_hull(points, flat, np.asarray(table.T_robot_cam)[:3, 3])
        if hull is None:
            break
        if points_in_hull_mask(points.reshape(-1, 3).take(pixels, axis=0)[:, :2], hull, 0.0).all():
            found.put(pixels, found.max() + 1)
    return found


def find_enclosed_floors(
    above: Mask,
    height: Array,
    known: Mask,
    frame: RGBDFrame,
    table: TableFrame,
    config: EnclosedFloors = DEFAULT.segmentation.floors,
) -> Labels:
    """(H, W) labels, from 1, of the ``known`` pieces that ``above`` encloses and whose median height exceeds the
    table's, if only by less than the noise of a pixel. The robot or a shadow may cut the enclosure.

    Args:
        above: (H, W) pixels that rise above the table.
        height: (H, W) m, smoothed.
        known: (H, W) pixels of known height, without those of no object.
        frame: the photo as it was measured: smoothing removes walls that are thinner than three pixels.
        table: the table in it.
    """
    tall = robot_frame_point_map(frame, table)[..., 2] > config.wall
    walls = (
        cv2.morphologyEx((tall | (frame.depth <= 0)).astype(np.uint8), cv2.MORPH_CLOSE, np.ones((3, 3), np.uint8)) > 0
    )
    low = known & ~above & ~walls
    pieces = label_connected_components(low.astype(np.uint8), int(config.pixels * above.size))
    beside = share_of_borders(pieces, above | tall)
    floors = np.zeros_like(pieces)
    for label, pixels in enumerate(pixels_by_label(pieces), 1):
        if beside[label] > config.cut and np.nanmedian(height.take(pixels)) > config.floor:
            floors.put(pixels, label)
    return floors


def add_enclosed_floors(labels: Labels, floors: Labels, config: EnclosedFloors) -> Labels:
    """The labels, with each of the ``floors`` (H, W) assigned to the segment along most of its border."""
    result = labels.copy()
    around = np.ones((2 * config.gap + 1,) * 2, np.uint8)
    for pixels in pixels_by_label(floors):
        floor = np.zeros(labels.shape, np.uint8)
        floor.put(pixels, 1)
        ring = np.asarray(cv2.dilate(floor, around) > floor, np.bool_)
        beside = np.bincount(labels[ring], minlength=1)
        beside[0] = 0
        if beside.max() > config.owned * np.count_nonzero(ring):
            result.put(pixels, np.argmax(beside))
    return result
