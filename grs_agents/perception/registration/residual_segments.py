"""What of a segment its asset does not explain: another thing that stands in, on or against it in the photo."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np
import numpy.typing as npt

from grs_agents.errors import InputError
from grs_agents.perception.image_geometry import Index, Labels, components
from grs_agents.perception.registration.surface_inliers import ON, AssetSurface
from grs_agents.perception.segmentation.candidates import candidates_of
from grs_agents.perception.table import projected, robot_points_at
from grs_agents.perception.types import Array, Candidate, Mask, RGBDFrame, TableFrame

OFF = 0.012
"""Points farther than this (m) from an asset's surface are not its own; sensors and poses are better than that."""
FITS = 0.5
"""An asset that explains less than this share of its segment is the wrong one, or stands wrongly: it tells nothing."""
SHOWN, IN_THE_AIR = 0.35, 0.1
"""At least and at most these shares of the asset's near surface are where one was measured, and before it."""
SMALLEST = 0.0006
"""The least share of the picture that something left over covers."""
JOINED = 0.3
"""A segment of which more than this share is on the surfaces of other things is theirs and the rest."""
Picture = npt.NDArray[np.uint8]
KERNEL = np.ones((3, 3), np.uint8)


def _stands(shell: AssetSurface, frame: RGBDFrame, table: TableFrame) -> bool:
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


@dataclass(frozen=True)
class ResidualCandidates:
    """What is found once assets stand.

    Attributes:
        candidates: so far they were taken for parts of other things.
        divided: segments without an asset, by index, that are these and parts of things whose assets are known.
    """

    candidates: tuple[Candidate, ...] = ()
    divided: tuple[int, ...] = ()


def residual_candidates(
    masks: Sequence[Mask], shells: Sequence[AssetSurface | None], frame: RGBDFrame, table: TableFrame, first: int
) -> ResidualCandidates:
    """What `left_over` finds, measured and numbered from ``first``."""
    labels, divided = left_over(masks, shells, frame, table)
    try:
        found = candidates_of(frame, table, labels)
    except InputError:  # nothing, or nothing that could be an object
        return ResidualCandidates(divided=divided)
    return ResidualCandidates(tuple(replace(one, id=first + index) for index, one in enumerate(found)), divided)


def left_over(
    masks: Sequence[Mask], shells: Sequence[AssetSurface | None], frame: RGBDFrame, table: TableFrame
) -> tuple[Labels, tuple[int, ...]]:
    """(H, W) labels from 1 of what is left over of segments once their assets stand, 0 elsewhere; and which it divides.

    Args:
        masks: (H, W) of each segment.
        shells: the surface of each segment's asset, where that is known.
        frame, table: the photo and its pose.
    """
    known = [shell for shell in shells if shell is not None]
    labels, divided = np.zeros(frame.depth.shape, np.int32), list[int]()
    for index, (mask, shell) in enumerate(zip(masks, shells, strict=True)):
        cloud = _Cloud.of(mask, frame, table)
        rest = _without(cloud, known) if shell is None else _beside(cloud, shell, frame, table)
        if rest is None:
            continue
        pieces = components(cv2.morphologyEx(rest, cv2.MORPH_OPEN, KERNEL), int(SMALLEST * rest.size))
        labels = np.where(pieces > 0, pieces + labels.max(), labels)
        divided += [index] if shell is None else []
    return labels, tuple(divided)


@dataclass(frozen=True)
class _Cloud:
    """The pixels of a segment, and their measured (N, 3) points, m, robot frame."""

    rows: Index
    columns: Index
    points: Array
    shape: tuple[int, ...]

    @classmethod
    def of(cls, mask: Mask, frame: RGBDFrame, table: TableFrame) -> "_Cloud":
        rows, columns = np.nonzero(mask & (frame.depth > 0))
        return cls(rows, columns, robot_points_at(frame, table, rows, columns), frame.depth.shape)

    def picture(self, chosen: Mask) -> Picture:
        """(H, W) where those are of which ``chosen`` (N,) is true."""
        drawn = np.zeros(self.shape, np.uint8)
        drawn[self.rows[chosen], self.columns[chosen]] = 1
        return drawn


def _beside(cloud: _Cloud, shell: AssetSurface, frame: RGBDFrame, table: TableFrame) -> Picture | None:
    """(H, W) what of a segment is not on the surface of its asset; ``None`` where that says nothing."""
    off = (shell.distances(cloud.points) > OFF) & (cloud.points[:, 2] > OFF)  # the table is no thing
    if not len(off) or off.mean() > 1 - FITS or not _stands(shell, frame, table):
        return None
    return cloud.picture(off)


def _without(cloud: _Cloud, shells: Sequence[AssetSurface]) -> Picture | None:
    """(H, W) what of a segment is not on the surfaces of other things; ``None`` where little of it is."""
    near = np.full(len(cloud.points), np.inf)
    for shell in shells:
        near = np.minimum(near, shell.near(cloud.points, OFF))
    theirs = cv2.morphologyEx(cloud.picture(near < ON), cv2.MORPH_OPEN, KERNEL)  # a thin strip touches them
    return cloud.picture(near > OFF) if theirs.sum() > JOINED * len(near) else None
