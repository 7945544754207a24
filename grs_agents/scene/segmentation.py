"""Segment what stands on the table: the foreground's smooth patches, with the parts of one object merged."""

import numpy as np

from grs_agents.scene.foreground import foreground, smoothed
from grs_agents.scene.frame import RGBDFrame
from grs_agents.scene.geometry import Labels
from grs_agents.scene.merging import merge_parts
from grs_agents.scene.patches import patches
from grs_agents.scene.table import robot_points
from grs_agents.scene.types import TableFrame

SMALLEST = 0.0004
"""The least share of the picture that an object covers."""


def segment(frame: RGBDFrame, table: TableFrame) -> Labels:
    """(H, W) labels: 0 for table and background, 1..N for the segments."""
    smooth = smoothed(frame)
    points = robot_points(smooth, table)
    above = foreground(points, smooth.depth)
    labels = merge_parts(patches(smooth, above), points)
    smallest = int(SMALLEST * above.size)
    areas = np.bincount(labels.ravel())
    kept = [label for label in range(1, len(areas)) if areas[label] >= smallest]
    numbers = np.zeros(len(areas), np.int32)
    numbers[kept] = np.arange(1, len(kept) + 1)
    return numbers[labels]
