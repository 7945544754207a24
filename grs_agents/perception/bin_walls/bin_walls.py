"""The walls of a bin that the things lie in: straight, upright, thin, level at the top and all around.

Seen from above they are the sides of a rectangle, of which the robot, things and the picture's border may hide parts.
It is checked against the photo: where the camera looks past a rim that should be there, there is no wall.
"""

from collections.abc import Sequence
from dataclasses import replace

import cv2
import numpy as np
import numpy.typing as npt

from grs_agents.perception.bin_walls.configuration import CONFIG
from grs_agents.perception.bin_walls.seen_walls import SeenWalls
from grs_agents.perception.bin_walls.straight_lines import likely_axes, raised_cells
from grs_agents.perception.bin_walls.view import Sight, View
from grs_agents.perception.bin_walls.wall import SIDES, Wall, pixels_beyond_walls, pixels_near_walls
from grs_agents.perception.bin_walls.wall_search import find_walls, holds_things
from grs_agents.perception.image_geometry import label_connected_components, values_in_mask
from grs_agents.perception.segmentation.patch_cutting import foreground_pixel_mask, smooth_frame_depth
from grs_agents.perception.table_finding import robot_frame_point_map
from grs_agents.perception.types import Array, Mask, RGBDFrame, TableFrame
from grs_agents.perception.working_resolution import downscale_frame, downscale_mask, repeat_cells


def find_bin_walls(frame: RGBDFrame, table: TableFrame, robot: Mask) -> SeenWalls:
    """Where the walls of a bin around the things are seen.

    Args:
        frame: the photo.
        table: the table in it, which is the bin's floor.
        robot: (H, W) the pixels that are known to show the robot.
    """
    small, factor = downscale_frame(replace(frame, depth=np.where(robot, np.float32(0), frame.depth)))
    smooth = smooth_frame_depth(small)
    points, pose = robot_frame_point_map(smooth, table), np.asarray(table.T_robot_cam)
    # The table is seen up to the robot: without the strip beside it, what stands there may be over no table.
    above = foreground_pixel_mask(points, smooth.depth, pose[:3, 3])
    sure = above & ~_mixed_pixels(smooth.depth)
    sights: list[Sight] = []
    for width in (CONFIG.blurred, CONFIG.edge):
        near = cv2.dilate(robot.astype(np.uint8), np.ones((2 * width + 1,) * 2, np.uint8)) > 0
        clear = ~downscale_mask(near, factor)
        view = View(small.camera, np.where(clear, small.depth, 0).astype(np.float64), pose)
        seen, unmixed = (raised_cells(values_in_mask(points, pixels & clear)) for pixels in (above, sure))
        sights.append(Sight(seen, unmixed, view))
    cells, nowhere = sights[0].cells, np.zeros(frame.depth.shape, np.bool_)
    if min(len(cells), len(sights[0].unmixed)) < CONFIG.fewest:
        return SeenWalls(nowhere, nowhere)
    for likely in likely_axes(cells):
        walls, axes = find_walls(sights, likely)
        if walls and holds_things(walls, axes, cells):
            break
    else:
        return SeenWalls(nowhere, nowhere)
    full, low = robot_frame_point_map(frame, table), max(CONFIG.lowest, CONFIG.deviations * table.residual)
    beside = cv2.distanceTransform((~robot).astype(np.uint8), cv2.DIST_L2, 5) < CONFIG.beside
    own = pixels_near_walls(walls, axes, full, low, (CONFIG.margin, CONFIG.level))
    own |= pixels_near_walls(walls, axes, full, low, (CONFIG.margin, CONFIG.mixed)) & beside
    own = np.asarray(cv2.morphologyEx(own.astype(np.uint8), cv2.MORPH_CLOSE, np.ones((5, 5), np.uint8)), np.bool_)
    known = downscale_mask(own, factor), downscale_mask(robot, factor)
    own |= repeat_cells(_pieces_at_border(walls, axes, points, above, *known), frame, factor)
    # What mixes robot and wall lies on a ray that meets the wall, or beyond the wall.
    height = walls[0].height
    down = _lowered_along_rays(full, pose[:3, 3], height)
    mixed = pixels_near_walls(walls, axes, down, low, (CONFIG.blur, CONFIG.level)) | pixels_beyond_walls(
        walls, axes, full, CONFIG.margin
    )
    mixed &= beside & (full[..., 2] < height + CONFIG.mixed) & ~robot
    return SeenWalls(own & ~robot, mixed, tuple(walls), axes)


def _mixed_pixels(depth: npt.NDArray[np.float32]) -> Mask:
    """(H, W) where depth (H, W) lies between that of a nearer and that of a farther surface: behind a bin's rim such
    points make a straight line in the air."""
    around = np.ones((5, 5), np.uint8)
    nearest = cv2.erode(np.where(depth > 0, depth, np.float32(np.inf)), around)
    return np.asarray((depth - nearest > CONFIG.apart) & (cv2.dilate(depth, around) - depth > CONFIG.apart), np.bool_)


def _pieces_at_border(walls: Sequence[Wall], axes: Array, points: Array, above: Mask, own: Mask, robot: Mask) -> Mask:
    """(H, W) what the picture's border leaves of further walls: thin pieces of what is ``above`` (H, W) the table, at
    the border and at a wall that is found or at the robot, with nothing beyond. ``own`` and ``robot`` (H, W) are the
    walls' and the robot's pixels."""
    beside = cv2.dilate((own | robot).astype(np.uint8), np.ones((2 * CONFIG.edge + 1,) * 2, np.uint8)) > 0
    border = np.ones(own.shape, np.bool_)
    border[CONFIG.edge : -CONFIG.edge, CONFIG.edge : -CONFIG.edge] = False
    rest, found = above & ~own, np.zeros(own.shape, np.bool_)
    labels = label_connected_components(rest.astype(np.uint8), 1)
    both = set(np.unique(labels[beside & rest])) & set(np.unique(labels[border & rest]))
    for side in set(range(len(SIDES))) - {wall.side for wall in walls}:
        axis, sign = SIDES[side]
        across = sign * (points[..., :2] @ axes.T)[..., axis]
        for label in both:
            piece = labels == label
            low, high = np.nanpercentile(across[piece], (10, 90))  # some of it is mixed with the robot
            beyond = rest & ~piece & (across > low)
            if high - low < CONFIG.thick and beyond.sum() <= CONFIG.stray * rest.sum():
                found |= piece
    return found


def _lowered_along_rays(points: Array, eye: Array, height: float) -> Array:
    """The ``points`` (H, W, 3), those higher than ``height`` moved away from the ``eye`` (3,) down to it."""
    drop = np.maximum((eye[2] - height) / np.maximum(eye[2] - points[..., 2:], 1e-6), 1)
    return np.asarray(eye + (points - eye) * drop, np.float64)
