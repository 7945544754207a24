"""Detection of a bin's walls: straight, upright, thin, level at the top and all around the objects.

Seen from above they are the sides of a rectangle, of which the robot, objects and the picture's border may hide parts.
The hypothesis is checked against the photo: if the camera sees past an expected rim, there is no wall.
"""

from collections.abc import Sequence
from dataclasses import replace

import cv2
import numpy as np

from grs_agents.perception.bin_walls.configuration import CONFIG
from grs_agents.perception.bin_walls.wall_search import Sight, find_walls, holds_objects, likely_axes, raised_cells
from grs_agents.perception.bin_walls.walls import SIDES, BinCamera, SeenWalls, Wall, pixels_near_walls
from grs_agents.perception.image_geometry import label_connected_components, values_in_mask
from grs_agents.perception.segmentation.patch_cutting import foreground_pixel_mask, smooth_frame_depth
from grs_agents.perception.table_finding import robot_frame_point_map
from grs_agents.perception.types import Array, Mask, RGBDFrame, TableFrame
from grs_agents.perception.working_resolution import downscale_frame, downscale_mask, repeat_cells


def find_bin_walls(frame: RGBDFrame, table: TableFrame, robot: Mask) -> SeenWalls:
    """Find the walls of a bin around the objects.

    Args:
        frame: the photo.
        table: the table in it, which is the bin's floor.
        robot: (H, W) pixels known to show the robot.
    """
    small, factor = downscale_frame(replace(frame, depth=np.where(robot, np.float32(0), frame.depth)))
    smooth = smooth_frame_depth(small)
    points, pose = robot_frame_point_map(smooth, table), np.asarray(table.T_robot_cam)
    # With the strip beside the robot, or objects there would be over no visible table.
    above = foreground_pixel_mask(points, smooth.depth, pose[:3, 3])
    # Flying pixels, between a nearer and a farther surface, form a straight line in the air behind a bin's rim.
    around = np.ones((5, 5), np.uint8)
    nearest = cv2.erode(np.where(smooth.depth > 0, smooth.depth, np.float32(np.inf)), around)
    flying = (smooth.depth - nearest > CONFIG.apart) & (cv2.dilate(smooth.depth, around) - smooth.depth > CONFIG.apart)
    sure = above & ~np.asarray(flying, np.bool_)
    sights: list[Sight] = []
    for width in (CONFIG.blurred, CONFIG.edge):
        near = cv2.dilate(robot.astype(np.uint8), np.ones((2 * width + 1,) * 2, np.uint8)) > 0
        clear = ~downscale_mask(near, factor)
        camera = BinCamera(small.camera, np.where(clear, small.depth, 0).astype(np.float64), pose)
        seen, unmixed = (raised_cells(values_in_mask(points, pixels & clear)) for pixels in (above, sure))
        sights.append(Sight(seen, unmixed, camera))
    cells, nowhere = sights[0].cells, np.zeros(frame.depth.shape, np.bool_)
    if min(len(cells), len(sights[0].unmixed)) < CONFIG.fewest:
        return SeenWalls(nowhere, nowhere)
    for likely in likely_axes(cells):
        walls, axes = find_walls(sights, likely)
        if walls and holds_objects(walls, axes, cells):
            break
    else:
        return SeenWalls(nowhere, nowhere)
    full, low = robot_frame_point_map(frame, table), max(CONFIG.lowest, CONFIG.deviations * table.residual)
    beside = cv2.distanceTransform((~robot).astype(np.uint8), cv2.DIST_L2, 5) < CONFIG.beside
    shown = pixels_near_walls(walls, axes, full, low, (CONFIG.margin, CONFIG.level))
    shown |= pixels_near_walls(walls, axes, full, low, (CONFIG.margin, CONFIG.mixed)) & beside
    shown = np.asarray(cv2.morphologyEx(shown.astype(np.uint8), cv2.MORPH_CLOSE, np.ones((5, 5), np.uint8)), np.bool_)
    known = downscale_mask(shown, factor), downscale_mask(robot, factor)
    shown |= repeat_cells(_pieces_at_border(walls, axes, points, above, *known), frame, factor)
    # Mixtures of robot and wall lie on rays that meet the wall (points lowered along them to the rim), or beyond it.
    eye, height = pose[:3, 3], walls[0].height
    drop = np.maximum((eye[2] - height) / np.maximum(eye[2] - full[..., 2:], 1e-6), 1)
    lowered = np.asarray(eye + (full - eye) * drop, np.float64)
    mixed = pixels_near_walls(walls, axes, lowered, low, (CONFIG.blur, CONFIG.level))
    local = full[..., :2] @ axes.T
    for wall in walls:
        axis, sign = SIDES[wall.side]
        mixed |= sign * local[..., axis] > wall.outer + CONFIG.margin
    mixed &= beside & (full[..., 2] < height + CONFIG.mixed) & ~robot
    return SeenWalls(shown & ~robot, mixed, tuple(walls), axes)


def _pieces_at_border(walls: Sequence[Wall], axes: Array, points: Array, above: Mask, shown: Mask, robot: Mask) -> Mask:
    """(H, W) pieces of further walls at the picture's border: thin components of ``above`` (H, W) that touch the border
    and a found wall or the robot, with nothing beyond. ``shown`` and ``robot`` (H, W) are the walls' and the robot's
    pixels."""
    beside = cv2.dilate((shown | robot).astype(np.uint8), np.ones((2 * CONFIG.edge + 1,) * 2, np.uint8)) > 0
    border = np.ones(shown.shape, np.bool_)
    border[CONFIG.edge : -CONFIG.edge, CONFIG.edge : -CONFIG.edge] = False
    rest, found = above & ~shown, np.zeros(shown.shape, np.bool_)
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
