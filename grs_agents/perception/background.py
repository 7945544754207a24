"""What the photo shows besides the table and the objects, as a surface to look at and boxes to bump into."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import cv2
import numpy as np

from grs_agents.base import Vec3
from grs_agents.perception.background_boxes import boxes_around
from grs_agents.perception.background_surface import Mesh, surface_of
from grs_agents.perception.frame import Array, Mask, RGBDFrame
from grs_agents.perception.image_geometry import components, within
from grs_agents.perception.segmentation.foreground import jumps, smoothed
from grs_agents.perception.table import robot_points, tolerance
from grs_agents.perception.types import Aabb, TableFrame
from grs_agents.perception.working_resolution import reduced

SPAN: Final = (np.array([-2.0, -2.0, -1.0]), np.array([2.0, 2.0, 2.0]))
"""Corners (m, robot frame) of the space around the robot that is reconstructed."""
MARGIN: Final = 0.05
"""The background keeps this far (m) away from objects."""
CLEAR: Final = 0.02
"""What of it is solid, after its simplification, still keeps this far (m) away from them."""
EDGE: Final = 200
"""Pixels around an object, as a share of the picture's width (1/EDGE), that may mix it with what is behind it."""
SMALLEST: Final = 0.0004
"""The least share of the picture that a piece of the background covers."""


@dataclass(frozen=True)
class Background:
    """A reconstructed background, in the robot frame.

    Attributes:
        mesh: its surface.
        boxes: (B, 2, 3) lowest and highest corners (m) of the boxes that are solid.
        color: mean red, green, blue, 0..1.
        pixels: how many of the (reduced) photo's pixels it was made from.
    """

    mesh: Mesh
    boxes: Array
    color: Vec3
    pixels: int


def reconstruct(
    frame: RGBDFrame, table: TableFrame, objects: Mask, boxes: Sequence[Aabb], arm: Array, voxel: float
) -> Background | None:
    """Reconstruct what is left of a photo after its objects and its table are taken out.

    Args:
        frame: the photo with depth.
        table: where the table is.
        objects: (H, W) pixels of the objects.
        boxes: around the objects; the background keeps away from them.
        arm: (N, 4) centres and radii (m, robot frame) of spheres around the arm at home; it keeps away from them too.
        voxel: edge of the cells of the signed distance, metres.

    Returns:
        ``None`` if nothing is left.

    Raises:
        ConfigError: scikit-image is not installed.
    """
    small, factor = reduced(frame)
    rows, columns = small.depth.shape
    # A cell of the smaller photo is an object's if any of its pixels is.
    whole = objects[: rows * factor, : columns * factor]
    taken = np.asarray(whole.reshape(rows, factor, columns, factor).any(axis=(1, 3)), np.bool_)
    smooth = smoothed(small)
    points = robot_points(smooth, table)
    lows, highs = np.array([one.low for one in boxes]).reshape(-1, 3), np.array([one.high for one in boxes])
    keep_out = np.stack([lows, highs.reshape(-1, 3)], axis=1)
    left = left_over(smooth, points, taken, keep_out, arm)
    if not left.any():
        return None
    raw = surface_of(smooth, table, left, voxel)
    solid = boxes_around(raw.vertices, 2 * voxel)
    solid = solid[~_touching(solid, keep_out, arm, CLEAR)]
    if not len(solid):
        return None
    mean = small.rgb[left].mean(axis=0) / 255
    color = (float(mean[0]), float(mean[1]), float(mean[2]))
    return Background(raw.simplified(2 * voxel), solid, color, int(left.sum()))


def left_over(frame: RGBDFrame, points: Array, objects: Mask, boxes: Array, arm: Array) -> Mask:
    """(H, W) pixels of surfaces around the robot that are neither objects nor table.

    Args:
        frame: smoothed.
        points: (H, W, 3) its points, robot frame.
        objects: (H, W) pixels of objects.
        boxes: (N, 2, 3) corners around the objects, metres.
        arm: (N, 4) spheres around the arm at home.
    """
    size = 2 * max(2, frame.depth.shape[1] // EDGE) + 1
    near_objects = cv2.dilate(objects.astype(np.uint8), np.ones((size, size), np.uint8)) > 0
    below, right = jumps(frame.depth)
    cut = below | right
    cut[1:] |= below[:-1]
    cut[:, 1:] |= right[:, :-1]
    table = np.abs(np.nan_to_num(points[..., 2], nan=0.0)) < 2 * tolerance(frame.depth.astype(np.float64))
    left = (frame.depth > 0) & ~near_objects & ~cut & ~table
    rows, columns = np.nonzero(left)
    cloud = points[rows, columns]
    kept = within(cloud, *SPAN)
    for low, high in boxes:
        kept &= ~within(cloud, low - MARGIN, high + MARGIN)
    for x, y, z, radius in arm:
        kept &= ((cloud - (x, y, z)) ** 2).sum(axis=1) > (radius + MARGIN) ** 2
    left[rows, columns] = kept
    return components(left.astype(np.uint8), int(SMALLEST * left.size)) > 0


def _touching(solid: Array, boxes: Array, arm: Array, margin: float) -> Mask:
    """Which boxes, (B, 2, 3), come nearer than ``margin`` to the objects' ``boxes`` or the arm's spheres."""
    touching = np.zeros(len(solid), np.bool_)
    for low, high in boxes:
        touching |= ((solid[:, 0] < high + margin) & (solid[:, 1] > low - margin)).all(axis=1)
    for x, y, z, radius in arm:
        nearest = np.clip((x, y, z), solid[:, 0], solid[:, 1])
        touching |= ((nearest - (x, y, z)) ** 2).sum(axis=1) < (radius + margin) ** 2
    return touching
