"""Which object a pixel shows is told by its colour where depth does not tell: what is dark, shiny or in the sensor's
shadow has none, and between two surfaces it is mixed."""

from collections.abc import Mapping, Sequence
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

TABLE = 1  # the marker of everything that is no object; an object's is the next number after its own


def fit_masks_to_color(
    objects: Sequence[Candidate],
    frame: RGBDFrame,
    left_out: Mask,
    config: ColorBorders = DEFAULT.segmentation.color_borders,
) -> tuple[Candidate, ...]:
    """The objects with the pixels without depth that show them, and with their borders where colours change. From the
    rest of the pixels a watershed of the photo's colours (Meyer, "Color image segmentation", 1992) goes in, and its
    parts meet where the colours change. On a border each pixel then goes to whom the colours around it say. Without
    depth an object reaches only a little beyond its convex outline. One that the user gave stays as it is. So do
    borders in a photo larger than the working size, which were fitted to it.

    Args:
        objects: numbered from 1.
        frame: the photo.
        left_out: (H, W) what is known to be no object.
    """
    small, factor = downscale_frame(frame)
    masks = {one.id: downscale_mask(one.mask, factor) for one in objects}
    before = np.full(small.depth.shape, TABLE, np.int32)
    for number in sorted(masks, key=lambda number: -np.count_nonzero(masks[number])):
        before[masks[number]] = TABLE + number
    near = _grown_outlines(masks, config.reach)
    fixed = downscale_mask(left_out, factor) | np.isin(before, [TABLE + one.id for one in objects if one.given])
    within = np.logical_or.reduce([np.zeros_like(fixed), *near.values()])
    unknown = (before == TABLE) & (small.depth <= 0) & within & ~fixed
    border = _borders(before, config) & ~fixed & ~unknown if factor == 1 else np.zeros_like(fixed)
    if not (unknown | border).any():
        return tuple(objects)
    owners = cv2.watershed(np.ascontiguousarray(small.rgb), np.where(unknown | border, 0, before).astype(np.int32))
    owners = np.where(owners < 0, before, owners)  # where two parts meet
    owners = _owners_by_colors_around(owners, border, ~(unknown | border), small.rgb, config)
    for number, outline in near.items():
        owners[unknown & (owners == TABLE + number) & ~outline] = TABLE
    free = (frame.depth <= 0) & ~left_out
    for one in objects:
        free &= ~one.mask
    free |= repeat_cells(border, frame, factor)

    def fitted(one: Candidate) -> Candidate:
        was, now = before == TABLE + one.id, owners == TABLE + one.id
        if one.given or (was == now).all():
            return one
        mask = (one.mask & ~repeat_cells(was & ~now, frame, factor)) | (repeat_cells(now, frame, factor) & free)
        return replace(one, mask=mask, crop=crop_segment(frame, mask))

    return tuple(map(fitted, objects))


def _grown_outlines(masks: Mapping[int, Mask], by: int) -> dict[int, Mask]:
    """The convex outline of each mask (h, w) that holds a pixel, grown by so many pixels."""
    square = np.ones((2 * by + 1,) * 2, np.uint8)
    outlines = {number: convex_outline_mask(mask).astype(np.uint8) for number, mask in masks.items() if mask.any()}
    return {number: cv2.dilate(outline, square) > 0 for number, outline in outlines.items()}


def _borders(owners: Labels, config: ColorBorders) -> Mask:
    """(h, w) the pixels beside such of another owner, but for those of what is hardly more than its border."""
    square, values = np.ones((2 * config.border + 1,) * 2, np.uint8), owners.astype(np.float32)
    border = np.asarray(cv2.dilate(values, square) != cv2.erode(values, square), np.bool_)
    whole, inner = np.bincount(owners.ravel()), np.bincount(owners[~border], minlength=int(owners.max()) + 1)
    return border & (inner >= config.inner * whole)[owners]


def _owners_by_colors_around(owners: Labels, border: Mask, known: Mask, rgb: Image, config: ColorBorders) -> Labels:
    """(h, w) the owners, where each pixel of the ``border`` goes to the owner that its colour speaks for most.

    Whether a pixel is an owner's is a linear function of its colour, fitted to the ``known`` pixels around it, as in a
    guided filter (He et al., "Guided image filtering", ECCV 2010).
    """
    if not border.any():
        return owners
    side, colors = (2 * config.around + 1,) * 2, rgb.astype(np.float64) / 255

    def around(picture: Array) -> Array:
        sums = cv2.boxFilter(picture, cv2.CV_64F, side, normalize=False, borderType=cv2.BORDER_CONSTANT)
        return np.asarray(sums, np.float64)

    weight = known.astype(np.float64)
    count, own = around(weight)[border] + 1e-6, colors[border]
    mean = around(colors * weight[..., None])[border] / count[:, None]
    spread = np.empty((len(own), 3, 3))
    for first, second in combinations_with_replacement(range(3), 2):
        products = around(colors[..., first] * colors[..., second] * weight)[border] / count
        spread[:, first, second] = spread[:, second, first] = products - mean[:, first] * mean[:, second]
    spread += config.color_noise**2 * np.eye(3)
    pull = np.linalg.solve(spread, (own - mean)[..., None])[..., 0]
    index = np.full(border.shape, -1, np.int64)
    index[border] = np.arange(len(own))
    most, found, before = np.full(len(own), -np.inf), owners[border], owners[border]
    for owner in np.unique(owners[known]).tolist():
        mine = known & (owners == owner)
        window = grow_window(mask_bounding_slices(mine), config.around)
        here = border[window]
        at, share = index[window][here], weight[window] * mine[window]
        mixed = around(colors[window] * share[..., None])[here] / count[at, None]
        speaks = around(share)[here] / count[at]
        speaks += ((mixed - mean[at] * speaks[:, None]) * pull[at]).sum(axis=1) + config.stay * (before[at] == owner)
        found[at] = np.where(speaks > most[at], owner, found[at])
        most[at] = np.maximum(most[at], speaks)
    changed = owners.copy()
    changed[border] = found
    return changed
