"""What of a segment its asset does not explain: another thing that stands in, on or against it in the photo."""

from collections.abc import Sequence
from dataclasses import replace

import cv2
import numpy as np

from grs_agents.errors import InputError
from grs_agents.scene.candidates import candidates_of
from grs_agents.scene.explaining import Shell
from grs_agents.scene.frame import Mask, RGBDFrame
from grs_agents.scene.geometry import Labels, components
from grs_agents.scene.table import projected, robot_points_at
from grs_agents.scene.types import Candidate, TableFrame

OFF = 0.012
"""Points farther than this (m) from an asset's surface are not its own; sensors and poses are better than that."""
FITS = 0.5
"""An asset that explains less than this share of its segment is the wrong one, or stands wrongly: it tells nothing."""
SHOWN, IN_THE_AIR = 0.35, 0.1
"""At least and at most these shares of the asset's near surface are where one was measured, and before it."""
SMALLEST = 0.0006
"""The least share of the picture that something left over covers."""
KERNEL = np.ones((3, 3), np.uint8)


def _stands(shell: Shell, frame: RGBDFrame, table: TableFrame) -> bool:
    """Whether an asset is the right one, as far as can be seen: its surface is where the photo shows one."""
    facing = ((shell.points - np.asarray(table.T_robot_cam)[:3, 3]) * shell.normals).sum(axis=1) < 0
    x, y, depth = projected(shell.points[facing], frame.camera, table)
    columns, rows = np.rint(x).astype(np.int64), np.rint(y).astype(np.int64)
    seen = (rows >= 0) & (rows < frame.depth.shape[0]) & (columns >= 0) & (columns < frame.depth.shape[1])
    measured = frame.depth[rows[seen], columns[seen]]
    before = measured[measured > 0] - depth[seen][measured > 0]
    if not len(before):
        return False
    return bool((np.abs(before) < OFF).mean() > SHOWN and (before > OFF).mean() < IN_THE_AIR)


def left_over(masks: Sequence[Mask], shells: Sequence[Shell | None], frame: RGBDFrame, table: TableFrame) -> Labels:
    """(H, W) labels from 1 of what is left over of segments once their assets stand; 0 elsewhere.

    Args:
        masks: (H, W) of each segment.
        shells: the surface of each segment's asset, where that is known.
        frame, table: the photo and its pose.
    """
    labels = np.zeros(frame.depth.shape, np.int32)
    for mask, shell in zip(masks, shells, strict=True):
        if shell is None:
            continue
        rows, columns = np.nonzero(mask & (frame.depth > 0))
        points = robot_points_at(frame, table, rows, columns)
        off = (shell.distances(points) > OFF) & (points[:, 2] > OFF)  # the table is no thing
        if not len(off) or off.mean() > 1 - FITS or not _stands(shell, frame, table):
            continue
        rest = np.zeros(labels.shape, np.uint8)
        rest[rows[off], columns[off]] = 1
        pieces = components(cv2.morphologyEx(rest, cv2.MORPH_OPEN, KERNEL), int(SMALLEST * rest.size))
        labels = np.where(pieces > 0, pieces + labels.max(), labels)
    return labels


def found_later(
    masks: Sequence[Mask], shells: Sequence[Shell | None], frame: RGBDFrame, table: TableFrame, first: int
) -> tuple[Candidate, ...]:
    """What `left_over` finds, measured and numbered from ``first``; so far it was taken for parts of other things."""
    labels = left_over(masks, shells, frame, table)
    try:
        found = candidates_of(frame, table, labels)
    except InputError:  # nothing, or nothing that could be an object
        return ()
    return tuple(replace(one, id=first + index) for index, one in enumerate(found))
