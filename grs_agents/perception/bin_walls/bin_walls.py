"""The walls of a bin that the things lie in: straight, upright, thin, level at the top and all around.

Seen from above they are the sides of a rectangle, of which the robot, things and the picture's border may hide parts.
It is checked against the photo: where the camera looks past a rim that should be there, there is no wall.
"""

from dataclasses import dataclass, replace

import cv2
import numpy as np

from grs_agents.perception.bin_walls.configuration import CONFIG
from grs_agents.perception.bin_walls.straight_lines import likely_axes, raised_cells
from grs_agents.perception.bin_walls.view import Sight, View
from grs_agents.perception.bin_walls.wall import pixels_near_walls
from grs_agents.perception.bin_walls.wall_search import find_walls, holds_things
from grs_agents.perception.image_geometry import values_in_mask
from grs_agents.perception.segmentation import foreground_pixel_mask, smooth_frame_depth
from grs_agents.perception.table_finding import robot_frame_point_map
from grs_agents.perception.types import Mask, RGBDFrame, TableFrame
from grs_agents.perception.working_resolution import downscale_frame, downscale_mask


@dataclass(frozen=True)
class SeenWalls:
    """Where a photo shows the walls of a bin; nowhere where there is none."""

    pixels: Mask  # (H, W)
    mixed: Mask  # (H, W) beside the robot, and so near to a wall that the sensor may have mixed the depth of both


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
    sights: list[Sight] = []
    for pixels in (CONFIG.blurred, CONFIG.edge):
        near = cv2.dilate(robot.astype(np.uint8), np.ones((2 * pixels + 1,) * 2, np.uint8)) > 0
        clear = ~downscale_mask(near, factor)
        view = View(small.camera, np.where(clear, small.depth, 0).astype(np.float64), pose)
        sights.append(Sight(raised_cells(values_in_mask(points, above & clear)), view))
    cells, nowhere = sights[0].cells, np.zeros(frame.depth.shape, np.bool_)
    if len(cells) < CONFIG.fewest:
        return SeenWalls(nowhere, nowhere)
    for likely in likely_axes(cells):
        walls, axes = find_walls(sights, likely)
        if walls and holds_things(walls, axes, cells):
            break
    else:
        return SeenWalls(nowhere, nowhere)
    full, low = robot_frame_point_map(frame, table), max(CONFIG.lowest, CONFIG.deviations * table.residual)
    own = pixels_near_walls(walls, axes, full, low, (CONFIG.margin, CONFIG.level))
    own = np.asarray(cv2.morphologyEx(own.astype(np.uint8), cv2.MORPH_CLOSE, np.ones((5, 5), np.uint8)), np.bool_)
    beside = cv2.distanceTransform((~robot).astype(np.uint8), cv2.DIST_L2, 5) < CONFIG.beside
    mixed = pixels_near_walls(walls, axes, full, low, (CONFIG.mixed, CONFIG.mixed)) & beside
    return SeenWalls(own & ~robot, mixed & ~robot)
