"""From a photo with its table to the objects on it: without robot and walls, whatever tool segments."""

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from grs_agents.perception.bin_walls import SeenWalls, find_bin_walls
from grs_agents.perception.scenery import SortedCandidates, separate_scenery_from_objects
from grs_agents.perception.segmentation import add_unmeasured_pixels
from grs_agents.perception.types import Candidate, Mask, RGBDFrame, TableFrame


def find_objects(
    frame: RGBDFrame, table: TableFrame, robot: Mask, segment: Callable[[RGBDFrame], Sequence[Candidate]]
) -> SortedCandidates:
    """The objects on the table, and what was left out. The pixels without depth that show an object are its too.

    Args:
        frame: the photo.
        table: the table in it.
        robot: (H, W) the pixels that are known to show the robot.
        segment: a segment tool; it is given the photo without the depth of the robot and of a bin's walls.
    """
    walls = find_bin_walls(frame, table, robot)
    candidates = segment(_without_depth(frame, robot | walls.pixels))
    if walls.pixels.any() and any(one.given for one in candidates):  # who gave masks says what is an object
        walls = SeenWalls(np.zeros_like(robot), np.zeros_like(robot))
        candidates = segment(_without_depth(frame, robot))
    found = separate_scenery_from_objects(candidates, robot, walls, frame, table)
    return replace(found, objects=add_unmeasured_pixels(found.objects, frame, found.left_out))


def _without_depth(frame: RGBDFrame, known: Mask) -> RGBDFrame:
    return replace(frame, depth=np.where(known, np.float32(0), frame.depth)) if known.any() else frame
