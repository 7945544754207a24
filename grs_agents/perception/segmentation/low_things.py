"""Low things that lie free on the table, such as pens: lower than the bound for one pixel, which must hold for noise
and for a table that is not quite flat, but higher than the table right around them on average."""

import cv2
import numpy as np
import numpy.typing as npt

from grs_agents.perception.configuration import DEFAULT
from grs_agents.perception.depth_noise import NORMAL
from grs_agents.perception.image_geometry import (
    Index,
    Labels,
    label_connected_components,
    pixels_by_label,
    points_in_hull_mask,
)
from grs_agents.perception.segmentation.configuration import LowThings
from grs_agents.perception.segmentation.patch_cutting import find_table_hull
from grs_agents.perception.table_finding import robot_frame_point_map
from grs_agents.perception.types import Array, Mask, RGBDFrame, TableFrame


def find_low_things(
    frame: RGBDFrame, table: TableFrame, taken: Mask, config: LowThings = DEFAULT.segmentation.low
) -> Labels:
    """(H, W) the low things, from 1.

    Args:
        frame: the photo as it was measured, at its working size.
        table: the table in it.
        taken: (H, W) what is known to rise, or to be no table.
    """
    points = robot_frame_point_map(frame, table)
    height = points[..., 2]
    wide = np.ones((config.gap,) * 2, np.uint8)
    unknown = cv2.morphologyEx(np.isnan(height).astype(np.uint8), cv2.MORPH_OPEN, wide) > 0
    near = cv2.dilate((taken | unknown).astype(np.uint8), np.ones((2 * config.apart + 1,) * 2, np.uint8)) > 0
    flat = (np.abs(height) < config.highest) & ~near
    found = np.zeros(height.shape, np.int32)
    pieces = _pieces_over_their_surroundings(height, flat, config)
    hull = find_table_hull(points, flat, np.asarray(table.T_robot_cam)[:3, 3]) if pieces else None
    for pixels in pieces:
        own = points.reshape(-1, 3).take(pixels, axis=0)[:, :2]
        if hull is not None and points_in_hull_mask(own, hull, 0.0).all():
            found.put(pixels, found.max() + 1)
    return found


def _pieces_over_their_surroundings(height: Array, flat: Mask, config: LowThings) -> list[Index]:
    """The pixels of each piece that is higher than the ``flat`` (H, W) ones around it, and lies mostly among such."""
    if not flat.any():
        return []
    relief = _average(height, flat, config.fine) - _average(height, flat, config.coarse)
    deviation = float(np.median(np.abs(relief[flat]))) / NORMAL
    raised = flat & (relief > max(config.lowest, config.deviations * deviation))
    kept: list[Index] = []
    for pixels in pixels_by_label(
        label_connected_components(raised.astype(np.uint8), int(config.smallest * height.size))
    ):
        own = np.zeros(height.shape, np.uint8)
        own.put(pixels, 1)
        ring = (cv2.dilate(own, np.ones((2 * config.ring + 1,) * 2, np.uint8)) > 0) & ~raised
        cut = ring[0].any() or ring[-1].any() or ring[:, 0].any() or ring[:, -1].any()  # what is around is not known
        if not cut and np.count_nonzero(flat & ring) > config.free * np.count_nonzero(ring):
            kept.append(pixels)
    return kept


def _average(height: Array, flat: Mask, width: int) -> npt.NDArray[np.float32]:
    """(H, W) the average height of the ``flat`` (H, W) pixels in a window of so many pixels, m."""
    known = np.asarray(cv2.blur(flat.astype(np.float32), (width, width)), np.float32)
    total = cv2.blur(np.where(flat, height, 0).astype(np.float32), (width, width))
    return np.asarray(total / np.maximum(known, 1e-6), np.float32)
