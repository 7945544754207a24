"""Working size of large photos: reduction before segmentation, and labels refined at full size."""

from typing import TypeVar
from weakref import WeakKeyDictionary

import cv2
import numpy as np
import numpy.typing as npt

from grs_agents.perception.configuration import DEFAULT
from grs_agents.perception.image_geometry import Labels, pixels_in_mask
from grs_agents.perception.plane_fitting import depth_tolerance
from grs_agents.perception.types import Array, Mask, RGBDFrame

CONFIG = DEFAULT.resolution
Value = TypeVar("Value", bound=np.generic)
_DOWNSCALED: WeakKeyDictionary[RGBDFrame, RGBDFrame] = WeakKeyDictionary()  # cache: many stages need it


def working_size_factor(frame: RGBDFrame) -> int:
    """Side of a cell of the frame at its working size, in pixels."""
    return max(1, round((frame.depth.size / CONFIG.pixels) ** 0.5))


def downscale_frame(frame: RGBDFrame) -> tuple[RGBDFrame, int]:
    """The frame at its working size, and the side of its cells in pixels.

    A cell's depth is the median of at most 3 x 3 pixels, never a mixture of two surfaces."""
    factor = working_size_factor(frame)
    if factor == 1:
        return frame, 1
    if (cached := _DOWNSCALED.get(frame)) is not None:
        return cached, factor
    height, width = frame.depth.shape
    rows, columns = height // factor, width // factor
    whole = frame.depth[: rows * factor, : columns * factor]
    offsets = sorted({0, factor // 2, factor - 1})
    values = np.stack([whole[down::factor, across::factor] for down in offsets for across in offsets], axis=-1)
    values = np.sort(np.where(values > 0, values, np.float32(np.inf)), axis=-1)
    count = np.isfinite(values).sum(axis=-1)
    depth = np.take_along_axis(values, np.maximum(count - 1, 0)[..., None] // 2, axis=-1)[..., 0]
    depth[3 * count < values.shape[-1]] = 0
    rgb = cv2.resize(frame.rgb[: rows * factor, : columns * factor], (columns, rows), interpolation=cv2.INTER_AREA)
    camera = frame.camera
    focal = {"fx": camera.fx / factor, "fy": camera.fy / factor}
    center = {"cx": (camera.cx + 0.5) / factor - 0.5, "cy": (camera.cy + 0.5) / factor - 0.5}
    small = camera.model_copy(update={**focal, **center, "width": columns, "height": rows})
    _DOWNSCALED[frame] = reduced = RGBDFrame(rgb.astype(np.uint8), depth, small, frame.source)
    return reduced, factor


def downscale_mask(mask: Mask, factor: int) -> Mask:
    """A mask (H, W) sampled at the middles of the cells, at the size of `downscale_frame`."""
    rows, columns = (side // factor for side in mask.shape)
    return mask[factor // 2 :: factor, factor // 2 :: factor][:rows, :columns]


def repeat_cells(cells: npt.NDArray[Value], frame: RGBDFrame, factor: int) -> npt.NDArray[Value]:
    """(H, W) value of each pixel's cell, from the (h, w) ``cells`` of the reduced frame."""
    camera, (height, width) = frame.camera, cells.shape
    rows = np.minimum(np.arange(camera.height, dtype=np.int64) // factor, height - 1)
    columns = np.minimum(np.arange(camera.width, dtype=np.int64) // factor, width - 1)
    return cells.take(columns, axis=1).take(rows, axis=0)  # much faster than both at once


def upscale_labels(labels: Labels, small: RGBDFrame, frame: RGBDFrame, factor: int) -> Labels:
    """(H, W) labels of the full frame from the (h, w) ``labels`` of the reduced frame.

    Pixels at borders take the label of the surrounding cell nearest in position, depth and colour."""
    full = repeat_cells(labels, frame, factor)
    around, values = np.ones((3, 3), np.uint8), labels.astype(np.float32)
    border = np.asarray(cv2.dilate(values, around) != cv2.erode(values, around), np.bool_)
    down, across = pixels_in_mask(repeat_cells(border, frame, factor))
    depth, color = frame.depth[down, across], frame.rgb[down, across].astype(np.float32)
    bound = depth_tolerance(depth.astype(np.float64))
    best = np.full(len(down), np.inf)
    taken = np.zeros(len(down), np.int32)
    for row_step in (-1, 0, 1):
        for column_step in (-1, 0, 1):
            row = np.clip(down // factor + row_step, 0, labels.shape[0] - 1)
            column = np.clip(across // factor + column_step, 0, labels.shape[1] - 1)
            away = np.hypot((row + 0.5) * factor - down - 0.5, (column + 0.5) * factor - across - 0.5) / factor
            cell_depth = small.depth[row, column]
            known = (depth > 0) & (cell_depth > 0)
            cost: Array = np.where(known, np.abs(depth - cell_depth) / bound, 1.0) + away / CONFIG.cells
            cost += np.linalg.norm(small.rgb[row, column] - color, axis=1) / CONFIG.color
            closer = cost < best
            best[closer], taken[closer] = cost[closer], labels[row, column][closer]
    full[down, across] = taken
    return full
