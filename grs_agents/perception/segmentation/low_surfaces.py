"""Floors of boxes, trays and plates: enclosed by walls, and above the table by less than the noise of a pixel. Averages
over many pixels reveal them."""

import cv2
import numpy as np

from grs_agents.perception.configuration import DEFAULT
from grs_agents.perception.image_geometry import (
    Labels,
    label_connected_components,
    pixels_by_label,
    share_of_borders,
)
from grs_agents.perception.segmentation.configuration import EnclosedFloors
from grs_agents.perception.table_finding import robot_frame_point_map
from grs_agents.perception.types import Array, Mask, RGBDFrame, TableFrame


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
