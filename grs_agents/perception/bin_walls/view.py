"""What of a wall the photo shows: where its rim is seen, hidden, or seen past."""

from dataclasses import dataclass, replace

import numpy as np

from grs_agents.perception.bin_walls.configuration import CONFIG
from grs_agents.perception.bin_walls.wall import Wall, extend_to_corners, rim_points
from grs_agents.perception.table_finding import depth_tolerance
from grs_agents.perception.types import Array, Camera, Mask


@dataclass(frozen=True)
class View:
    """The photo at its working size."""

    camera: Camera
    depth: Array  # (H, W) m, without the robot
    pose: Array  # (4, 4) robot frame from camera frame

    def look(self, rim: Array) -> tuple[Mask, Mask, Mask]:
        """Which of the (N, 3) points of a rim are seen, past which of them the camera sees something farther, and which
        of them are hidden by something nearer, or lie where the depth is not known."""
        camera = self.camera
        x, y, z = ((rim - self.pose[:3, 3]) @ self.pose[:3, :3]).T
        ahead = np.maximum(z, 1e-6)
        column, row = np.rint(camera.fx * x / ahead + camera.cx), np.rint(camera.fy * y / ahead + camera.cy)
        height, width = self.depth.shape
        inside = (z > 0) & (column >= 1) & (column < width - 1) & (row >= 1) & (row < height - 1)
        seen, past = np.zeros((2, len(rim)), np.bool_)
        rows, columns = row[inside].astype(np.int64), column[inside].astype(np.int64)
        offsets = [(down, across) for down in (-1, 0, 1) for across in (-1, 0, 1)]
        around = np.stack([self.depth[rows + down, columns + across] for down, across in offsets])
        away = np.where(around > 0, around - z[inside], np.nan)
        bound = CONFIG.apart + depth_tolerance(z[inside])
        seen[inside] = (np.abs(away) < bound).any(axis=0)
        past[inside] = (away > bound).all(axis=0)
        return seen, past, inside & ~seen & ~past


@dataclass(frozen=True)
class Sight:
    """What is seen so far from the robot that its depth is not mixed in."""

    cells: Array  # (N, 3) as `raised_cells` makes them
    unmixed: Array  # (M, 3) the same without points between two surfaces: they make straight lines in the air
    view: View


def seen_rim_length(wall: Wall, axes: Array, view: View) -> int:
    """How many centimetres of a rim are seen; 0 if it is not there wherever nothing hides it."""
    seen, past, _ = view.look(rim_points(wall, axes, wall.start, wall.end))
    return int(seen.sum()) if seen.sum() > CONFIG.seen * (seen | past).sum() else 0


def is_seen_all_along(wall: Wall, axes: Array, view: View) -> bool:
    """Whether a rim is seen wherever it is not hidden."""
    seen, past, _ = view.look(rim_points(wall, axes, wall.start, wall.end))
    return bool(past.sum() <= CONFIG.few or seen.sum() >= CONFIG.seen * (seen | past).sum())


def slide_to_rim(wall: Wall, axes: Array, view: View) -> Wall:
    """The wall, slid across by a little to where most of its rim is seen if the camera seems to look past it: a thin
    rim is missed by millimetres."""
    _, past, _ = view.look(rim_points(wall, axes, wall.start, wall.end))
    if past.sum() <= CONFIG.few:
        return wall
    moved = [replace(wall, inner=wall.inner + by, outer=wall.outer + by) for by in CONFIG.slides]
    looks = [view.look(rim_points(one, axes, one.start, one.end)) for one in moved]
    return moved[int(np.argmax([int(seen.sum()) - int(past.sum()) for seen, past, _ in looks]))]


def ends_in_sight(wall: Wall, end: float, sign: float, axes: Array, view: View) -> bool:
    """Whether the camera looks past where a wall would go on."""
    near, far = end + sign * CONFIG.gap, end + sign * (CONFIG.gap + CONFIG.free)
    _, past, _ = view.look(rim_points(wall, axes, min(near, far), max(near, far)))
    return bool(past.mean() > 0.5)


def _reach_along(sign: int, far: float, wall: Wall, axes: Array, view: View) -> float:
    """How far along it, m the way ``sign`` points, a wall is not seen past: at most ``far``."""
    near = wall.end if sign > 0 else -wall.start
    if far < near + CONFIG.open:  # another one is there
        return far
    rim = rim_points(wall, axes, *((near, far) if sign > 0 else (-far, -near)))[::sign]
    _, past, _ = view.look(rim)
    return near + int(past.argmax()) * CONFIG.line if past.any() else far


def extend_to_seen_corners(wall: Wall, walls: dict[int, Wall], axes: Array, view: View) -> Wall:
    """A wall that reaches to those that it meets; where none is found, to where the camera looks past it: it ends
    there, or behind what hides its corner."""
    whole = extend_to_corners(wall, walls)
    if wall.start == wall.end:  # it is not measured
        return whole
    start, end = _reach_along(-1, -whole.start, wall, axes, view), _reach_along(1, whole.end, wall, axes, view)
    return replace(whole, start=-start, end=end)
