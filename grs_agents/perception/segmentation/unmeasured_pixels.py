"""Which object the pixels without depth show: what is dark, shiny or in the sensor's shadow has colour all the same."""

from collections.abc import Sequence
from dataclasses import replace

import cv2
import numpy as np

from grs_agents.perception.configuration import DEFAULT
from grs_agents.perception.image_geometry import convex_outline_mask
from grs_agents.perception.segmentation.candidates import crop_segment
from grs_agents.perception.segmentation.configuration import UnmeasuredPixels
from grs_agents.perception.types import Candidate, Mask, RGBDFrame
from grs_agents.perception.working_resolution import downscale_frame, downscale_mask, repeat_cells

TABLE = 1  # the marker of everything that is no object; an object's is the next number after its own


def add_unmeasured_pixels(
    objects: Sequence[Candidate],
    frame: RGBDFrame,
    left_out: Mask,
    config: UnmeasuredPixels = DEFAULT.segmentation.unmeasured,
) -> tuple[Candidate, ...]:
    """The objects with the pixels without depth that show them. From what is measured around such pixels a watershed of
    the photo's colours (Meyer, "Color image segmentation", 1992) goes in, and its parts meet where the colours change.
    An object reaches no farther than its convex outline; one that the user gave stays as it is.

    Args:
        objects: numbered from 1.
        frame: the photo.
        left_out: (H, W) what is known to be no object.
    """
    small, factor = downscale_frame(frame)
    masks = {one.id: downscale_mask(one.mask, factor) for one in objects}
    markers = np.full(small.depth.shape, TABLE, np.int32)
    for number in sorted(masks, key=lambda number: -np.count_nonzero(masks[number])):
        markers[masks[number]] = TABLE + number
    blur = np.ones((2 * config.blur + 1,) * 2, np.uint8)
    outlines = {number: convex_outline_mask(mask).astype(np.uint8) for number, mask in masks.items() if mask.any()}
    within = {number: cv2.dilate(outline, blur) > 0 for number, outline in outlines.items()}
    unknown = (markers == TABLE) & (small.depth <= 0) & ~downscale_mask(left_out, factor)
    unknown &= np.logical_or.reduce([np.zeros_like(unknown), *within.values()])
    if not unknown.any():
        return tuple(objects)
    markers[unknown] = 0
    shown = cv2.watershed(np.ascontiguousarray(small.rgb), markers)
    free = (frame.depth <= 0) & ~left_out
    for one in objects:
        free &= ~one.mask
    found = {number: unknown & near & (shown == TABLE + number) for number, near in within.items()}
    return tuple(
        one
        if one.given or one.id not in found
        else _with_pixels(one, frame, free & repeat_cells(found[one.id], frame, factor))
        for one in objects
    )


def _with_pixels(one: Candidate, frame: RGBDFrame, more: Mask) -> Candidate:
    if not more.any():
        return one
    mask = one.mask | more
    return replace(one, mask=mask, crop=crop_segment(frame, mask))
