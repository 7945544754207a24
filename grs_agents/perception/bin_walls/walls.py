"""Walls of a bin: geometry in the bin's axes, and the visibility of their rims and sides in the photo."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from grs_agents.perception.bin_walls.configuration import CONFIG
from grs_agents.perception.plane_fitting import depth_tolerance
from grs_agents.perception.types import Array, Camera, Mask

SIDES = ((0, -1.0), (0, 1.0), (1, -1.0), (1, 1.0))
"""Axis across each wall, and the sign of its outward side."""


@dataclass(frozen=True)
class Wall:
    """A wall in the bin's axes: from ``inner`` to ``outer`` across, outward positive, ``start`` to ``end`` along; m."""

    side: int  # of `SIDES`
    inner: float
    outer: float
    start: float
    end: float
    height: float

    @property
    def middle(self) -> float:
        return (self.inner + self.outer) / 2


def rim_points(wall: Wall, axes: Array, start: float, end: float) -> Array:
    """(N, 3) points along the middle of a wall's rim, robot frame."""
    axis, sign = SIDES[wall.side]
    along = np.arange(start, end, CONFIG.line)
    across = np.full(len(along), sign * wall.middle)
    local = np.stack([across, along] if axis == 0 else [along, across], axis=1)
    return np.column_stack([local @ axes, np.full(len(along), wall.height)])


def side_points(wall: Wall, place: float, axes: Array) -> Array:
    """(N, 3) points of a wall's side at a place across, robot frame, from its rim down to the lowest raised height."""
    rim = rim_points(replace(wall, inner=place, outer=place), axes, wall.start, wall.end)
    heights = np.arange(wall.height, CONFIG.raised, -CONFIG.line)
    return np.concatenate([np.column_stack([rim[:, :2], np.full(len(rim), height)]) for height in heights])


def extend_to_corners(wall: Wall, walls: dict[int, Wall]) -> Wall:
    """The wall extended to the outsides of adjoining walls, and beyond the picture where none adjoins."""
    first = 2 * (1 - SIDES[wall.side][0])
    low, high = walls.get(first), walls.get(first + 1)
    start = -low.outer if low else wall.start - CONFIG.open
    end = high.outer if high else wall.end + CONFIG.open
    return Wall(wall.side, wall.inner, wall.outer, start, end, wall.height)


def pixels_near_walls(
    walls: Sequence[Wall], axes: Array, points: Array, low: float, margins: tuple[float, float]
) -> Mask:
    """(H, W) pixels whose ``points`` (H, W, 3) are higher than ``low`` and within ``margins`` (m, beside it and over
    its rim) of a wall."""
    local = points[..., :2] @ axes.T
    found = np.zeros(points.shape[:2], np.bool_)
    margin, over = margins
    for wall in walls:
        axis, sign = SIDES[wall.side]
        across, along = sign * local[..., axis], local[..., 1 - axis]
        near = (across > wall.inner - margin) & (across < wall.outer + margin)
        near &= (along > wall.start - margin) & (along < wall.end + margin)
        found |= near & (points[..., 2] > low) & (points[..., 2] < wall.height + over)
    return found


@dataclass(frozen=True)
class BinCamera:
    """Camera and depth of the photo at its working size."""

    camera: Camera
    depth: Array  # (H, W) m, without the robot
    pose: Array  # (4, 4) robot frame from camera frame

    def check_visibility(self, points: Array) -> tuple[Mask, Mask, Mask]:
        """Masks (N,) of points (N, 3) that are seen, that the camera sees past to something farther, and that are
        occluded or of unknown depth."""
        camera = self.camera
        x, y, z = ((points - self.pose[:3, 3]) @ self.pose[:3, :3]).T
        ahead = np.maximum(z, 1e-6)
        column, row = np.rint(camera.fx * x / ahead + camera.cx), np.rint(camera.fy * y / ahead + camera.cy)
        height, width = self.depth.shape
        inside = (z > 0) & (column >= 1) & (column < width - 1) & (row >= 1) & (row < height - 1)
        seen, past = np.zeros((2, len(points)), np.bool_)
        rows, columns = row[inside].astype(np.int64), column[inside].astype(np.int64)
        offsets = [(down, across) for down in (-1, 0, 1) for across in (-1, 0, 1)]
        around = np.stack([self.depth[rows + down, columns + across] for down, across in offsets])
        behind = np.where(around > 0, around - z[inside], np.nan)
        bound = CONFIG.apart + depth_tolerance(z[inside])
        seen[inside] = (np.abs(behind) < bound).any(axis=0)
        past[inside] = (behind > bound).all(axis=0)
        return seen, past, inside & ~seen & ~past

    def check_rim(self, wall: Wall, axes: Array) -> tuple[Mask, Mask, Mask]:
        """`check_visibility` of the points along a wall's rim."""
        return self.check_visibility(rim_points(wall, axes, wall.start, wall.end))

    def sees_rim(self, wall: Wall, axes: Array) -> bool:
        """Whether a rim is seen wherever it is not occluded."""
        seen, past, _ = self.check_rim(wall, axes)
        return bool(past.sum() <= CONFIG.few or seen.sum() >= CONFIG.seen * (seen | past).sum())

    def sees_beyond(self, longer: Wall, wall: Wall, axes: Array) -> bool:
        """Whether the ``longer`` wall runs across a ``wall`` and is seen beyond that."""
        axis, sign = SIDES[wall.side]
        end, corner = sign * (longer.end if sign > 0 else longer.start), wall.outer + CONFIG.strip
        if SIDES[longer.side][0] == axis or end <= corner:
            return False
        seen, _, _ = self.check_visibility(rim_points(longer, axes, *sorted((sign * corner, sign * end))))
        return bool(seen.sum() > CONFIG.few)


def slide_to_rim(wall: Wall, axes: Array, camera: BinCamera) -> Wall:
    """The wall, shifted across by millimetres to the best visibility of its rim if the camera seems to see past it."""
    _, past, _ = camera.check_rim(wall, axes)
    if past.sum() <= CONFIG.few:
        return wall
    moved = [replace(wall, inner=wall.inner + by, outer=wall.outer + by) for by in CONFIG.slides]
    checks = [camera.check_rim(shifted, axes) for shifted in moved]
    return moved[int(np.argmax([int(seen.sum()) - int(past.sum()) for seen, past, _ in checks]))]


def extend_to_seen_corners(wall: Wall, walls: dict[int, Wall], axes: Array, camera: BinCamera) -> Wall:
    """The wall extended to adjoining walls, or, without one, up to the point where the camera sees past its rim."""
    whole = extend_to_corners(wall, walls)
    if wall.start == wall.end:  # it is not measured
        return whole
    ends: list[float] = []
    for sign, near, far in ((-1, -wall.start, -whole.start), (1, wall.end, whole.end)):
        end = far
        if far >= near + CONFIG.open:  # no wall adjoins
            rim = rim_points(wall, axes, *((near, far) if sign > 0 else (-far, -near)))[::sign]
            _, past, _ = camera.check_visibility(rim)
            end = near + int(past.argmax()) * CONFIG.line if past.any() else far
        ends.append(sign * end)
    return replace(whole, start=ends[0], end=ends[1])


@dataclass(frozen=True)
class SeenWalls:
    """Pixels and geometry of a bin's walls in a photo; empty without a bin."""

    pixels: Mask  # (H, W)
    mixed: Mask  # (H, W) beside the robot, and near or beyond a wall: depth may be a mixture of both
    walls: tuple[Wall, ...] = ()
    axes: Array = field(default_factory=lambda: np.eye(2))  # (2, 2) the directions across them

    def has_as_rim(self, segment: Array, others: Array) -> bool:
        """Whether a segment is the visible rest of another wall's rim, beside the robot: long, thin, as high as the
        other rims, and outermost.

        Args:
            segment: (N, 3) its points, robot frame.
            others: (M, 3) those of the other segments.
        """
        segment, others = (points[np.isfinite(points[:, 2])] for points in (segment, others))
        if not self.walls or not len(segment):
            return False
        low, middle, high = np.percentile(segment[:, 2], (10, 50, 90))
        if abs(middle - self.walls[0].height) > CONFIG.level or high - low > CONFIG.level:
            return False
        local, around = segment[:, :2] @ self.axes.T, others[:, :2] @ self.axes.T
        for side in set(range(len(SIDES))) - {wall.side for wall in self.walls}:
            axis, sign = SIDES[side]
            inner, outer = np.percentile(sign * local[:, axis], (10, 90))
            start, end = np.percentile(local[:, 1 - axis], (2, 98))
            beyond = np.count_nonzero(sign * around[:, axis] > inner)
            is_strip = outer - inner < CONFIG.thick and end - start > CONFIG.short
            if is_strip and beyond <= CONFIG.stray * len(others):
                return True
        return False
