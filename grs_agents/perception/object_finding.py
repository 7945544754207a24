"""From a photo with its table to the objects on it: without robot and walls, whatever tool segments."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from grs_agents.perception.bin_walls.bin_walls import find_bin_walls
from grs_agents.perception.bin_walls.seen_walls import SeenWalls
from grs_agents.perception.scenery import SortedCandidates, separate_scenery_from_objects, unite_mask_with_candidates
from grs_agents.perception.segmentation.color_borders import fit_masks_to_color
from grs_agents.perception.types import Candidate, Mask, RGBDFrame, TableFrame


@dataclass(frozen=True)
class FoundObjects(SortedCandidates):
    """The objects with their borders, and what was left out."""

    blur: Mask  # (H, W) pixels at an object's border that have its depth, but not its colour


def find_objects(
    frame: RGBDFrame, table: TableFrame, robot: Mask, segment: Callable[[RGBDFrame], Sequence[Candidate]]
) -> FoundObjects:
    """The objects on the table, and what was left out. Their borders are where the colours change.

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
    objects = fit_masks_to_color(found.objects, frame, found.left_out)
    nothing = np.zeros_like(robot)
    blur = unite_mask_with_candidates(nothing, found.objects) & ~unite_mask_with_candidates(nothing, objects)
    return FoundObjects(objects, found.reasons, found.left_out, blur)


def _without_depth(frame: RGBDFrame, known: Mask) -> RGBDFrame:
    return replace(frame, depth=np.where(known, np.float32(0), frame.depth)) if known.any() else frame
