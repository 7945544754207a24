"""Object borders by colour, where depth is missing (dark, shiny or shadowed surfaces) or mixed (flying pixels)."""

from collections.abc import Sequence
from dataclasses import replace
from itertools import combinations_with_replacement

import cv2
import numpy as np

from grs_agents.perception.configuration import DEFAULT
from grs_agents.perception.image_geometry import Labels, convex_outline_mask, grow_window, mask_bounding_slices
from grs_agents.perception.segmentation.candidates import crop_segment
from grs_agents.perception.segmentation.configuration import ColorBorders
from grs_agents.perception.types import Array, Candidate, Image, Mask, RGBDFrame
from grs_agents.perception.working_resolution import downscale_frame, downscale_mask, repeat_cells

TABLE = 1  # watershed marker of everything that is no object; an object's marker is its number + 1


def fit_masks_to_color(
    objects: Sequence[Candidate],
    frame: RGBDFrame,
    left_out: Mask,
    config: ColorBorders = DEFAULT.segmentation.color_borders,
) -> tuple[Candidate, ...]:
    """Extend the objects over pixels without depth, and move their borders to colour edges.

    Pixels without depth are flooded by a watershed of the photo's colours (Meyer, "Color image segmentation", 1992), up
    to a margin around each object's convex outline. Border pixels are then reassigned by the colours around them.
    Objects given by the user stay as they are. So do borders in a photo larger than the working size.

    Args:
        objects: numbered from 1.
        frame: the photo.
        left_out: (H, W) pixels known to be no object.
    """
    small, factor = downscale_frame(frame)
    masks = {item.id: downscale_mask(item.mask, factor) for item in objects}
    before = np.full(small.depth.shape, TABLE, np.int32)
    for number in sorted(masks, key=lambda number: -np.count_nonzero(masks[number])):
        before[masks[number]] = TABLE + number
    square = np.ones((2 * config.reach + 1,) * 2, np.uint8)
    near = {
        number: cv2.dilate(convex_outline_mask(mask).astype(np.uint8), square) > 0
        for number, mask in masks.items()
        if mask.any()
    }
    fixed = downscale_mask(left_out, factor) | np.isin(before, [TABLE + item.id for item in objects if item.given])
    within = np.logical_or.reduce([np.zeros_like(fixed), *near.values()])
    unknown = (before == TABLE) & (small.depth <= 0) & within & ~fixed
    border = np.zeros_like(fixed)
    if factor == 1:  # but for objects that are hardly more than their border
        square, values = np.ones((2 * config.border + 1,) * 2, np.uint8), before.astype(np.float32)
        border = np.asarray(cv2.dilate(values, square) != cv2.erode(values, square), np.bool_)
        whole, inner = np.bincount(before.ravel()), np.bincount(before[~border], minlength=int(before.max()) + 1)
        border &= (inner >= config.inner * whole)[before] & ~fixed & ~unknown
    if not (unknown | border).any():
        return tuple(objects)
    owners = cv2.watershed(np.ascontiguousarray(small.rgb), np.where(unknown | border, 0, before).astype(np.int32))
    owners = np.where(owners < 0, before, owners)  # watershed lines
    if border.any():
        owners = _reassign_border_by_color(owners, border, ~(unknown | border), small.rgb, config)
    for number, outline in near.items():
        owners[unknown & (owners == TABLE + number) & ~outline] = TABLE
    free = (frame.depth <= 0) & ~left_out
    for item in objects:
        free &= ~item.mask
    free |= repeat_cells(border, frame, factor)

    fitted: list[Candidate] = []
    for item in objects:
        was, now = before == TABLE + item.id, owners == TABLE + item.id
        if item.given or (was == now).all():
            fitted.append(item)
            continue
        kept = item.mask & ~repeat_cells(was & ~now, frame, factor)
        mask = kept | (repeat_cells(now, frame, factor) & free)
        fitted.append(replace(item, mask=mask, crop=crop_segment(frame, mask)))
    return tuple(fitted)


def _reassign_border_by_color(owners: Labels, border: Mask, known: Mask, rgb: Image, config: ColorBorders) -> Labels:
    """(h, w) owners, with each ``border`` pixel assigned to its likeliest owner by colour.

    The likelihood is a linear function of colour, fitted to the ``known`` pixels around it, as in a guided filter (He
    et al., "Guided image filtering", ECCV 2010).
    """
    side, colors = (2 * config.around + 1,) * 2, rgb.astype(np.float64) / 255

    def around(picture: Array) -> Array:
        sums = cv2.boxFilter(picture, cv2.CV_64F, side, normalize=False, borderType=cv2.BORDER_CONSTANT)
        return np.asarray(sums, np.float64)

    weight = known.astype(np.float64)
    count, color = around(weight)[border] + 1e-6, colors[border]
    mean = around(colors * weight[..., None])[border] / count[:, None]
    spread = np.empty((len(color), 3, 3))
    for first, second in combinations_with_replacement(range(3), 2):
        products = around(colors[..., first] * colors[..., second] * weight)[border] / count
        spread[:, first, second] = spread[:, second, first] = products - mean[:, first] * mean[:, second]
    spread += config.color_noise**2 * np.eye(3)
    pull = np.linalg.solve(spread, (color - mean)[..., None])[..., 0]
    index = np.full(border.shape, -1, np.int64)
    index[border] = np.arange(len(color))
    most, found, before = np.full(len(color), -np.inf), owners[border], owners[border]
    for owner in np.unique(owners[known]).tolist():
        mine = known & (owners == owner)
        window = grow_window(mask_bounding_slices(mine), config.around)
        here = border[window]
        at, share = index[window][here], weight[window] * mine[window]
        mixed = around(colors[window] * share[..., None])[here] / count[at, None]
        likelihood = around(share)[here] / count[at]
        likelihood += ((mixed - mean[at] * likelihood[:, None]) * pull[at]).sum(axis=1) + config.stay * (
            before[at] == owner
        )
        found[at] = np.where(likelihood > most[at], owner, found[at])
        most[at] = np.maximum(most[at], likelihood)
    changed = owners.copy()
    changed[border] = found
    return changed
