"""The walls of a bin that the things lie in: straight, upright, thin, level at the top and all around.

Seen from above they are the sides of a rectangle, of which the robot, things and the picture's border may hide parts.
It is checked against the photo: where the camera looks past a rim that should be there, there is no wall.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np
import numpy.typing as npt

from grs_agents.perception.image_geometry import axes_from_yaws, label_connected_components, values_in_mask
from grs_agents.perception.segmentation import foreground_pixel_mask, smooth_frame_depth
from grs_agents.perception.table_finding import depth_tolerance, robot_frame_point_map
from grs_agents.perception.types import Array, Camera, Mask, RGBDFrame, TableFrame
from grs_agents.perception.working_resolution import downscale_frame, downscale_mask


@dataclass(frozen=True)
class BinWalls:
    """How the walls of a bin are told from things; lengths in m."""

    raised: float = 0.02  # walls are higher; lower is the floor
    highest: float = 0.3  # what is higher is no wall to reach over
    blurred: int = 8  # pixels around the robot are blurred by it,
    edge: int = 2  # by some sensors only so many
    cell: float = 0.005  # of the table seen from above
    fewest: int = 100  # cells: fewer are no walls
    turn: float = 2.0  # degrees: so far apart are the yaws that are tried first
    apart_yaws: int = 4  # of them: likely ones are at least so many apart
    hypotheses: int = 3  # yaws are tried
    rounds: int = 2  # of laying the axes along the walls
    line: float = 0.01  # cells are in a line within two of these; its length is counted by one
    outside: float = 0.1  # of what rises: less lies beyond a wall
    strip: float = 0.025  # on either side of a line its wall is looked for
    thick: float = 0.03  # walls are thinner, as they are seen
    level: float = 0.015  # rims differ less in height, and blur less far upward
    short: float = 0.08  # what is seen of a rim is longer
    apart: float = 0.015  # m along the ray: closer to where a rim should be is the rim, farther is seen past it
    seen: float = 0.75  # of what is not hidden of a rim: more is there
    few: int = 4  # cm of a rim: so little is seen or missing by chance
    fewest_walls: int = 2  # with a rim that is seen
    stray: float = 0.02  # of what rises below the rims: less lies beyond a wall whose rim is hidden
    columns: int = 2  # cm: a shorter line is no wall
    face: int = 6  # square centimetres of such a wall's side are seen
    slides: tuple[float, ...] = (0.0, -0.0025, 0.0025, -0.005, 0.005, -0.0075, 0.0075)  # so far a rim is off at most
    gap: float = 0.03  # corners may be blurred away
    free: float = 0.04  # what is seen past so far beyond the gap is where a wall ends
    open: float = 1.0  # a wall of which no end is seen may go on so far
    long: float = 0.5  # the rims seen are longer together
    things: int = 2  # a bin holds at least so many: a box with fewer is an object with its content
    thing: int = 4  # square centimetres: fewer are no thing
    margin: float = 0.01  # around walls: what is nearer is theirs
    beside: int = 20  # pixels: so near to the robot a sensor mixes its depth with that of walls
    mixed: float = 0.05  # and there their points are off by less
    lowest: float = 0.004  # what is lower is the floor
    deviations: float = 1.5  # and what is lower than so many standard deviations of the table's points


CONFIG = BinWalls()
SIDES = ((0, -1.0), (0, 1.0), (1, -1.0), (1, 1.0))
"""Axis across each wall, and the sign of its outward side."""


@dataclass(frozen=True)
class SeenWalls:
    """Where a photo shows the walls of a bin; nowhere where there is none."""

    pixels: Mask  # (H, W)
    mixed: Mask  # (H, W) beside the robot, and so near to a wall that the sensor may have mixed the depth of both


@dataclass(frozen=True)
class _Wall:
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


@dataclass(frozen=True)
class _View:
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
class _Sight:
    """What is seen so far from the robot that its depth is not mixed in."""

    cells: Array  # (N, 3) as `_raised_cells` makes them
    view: _View


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
    sights: list[_Sight] = []
    for pixels in (CONFIG.blurred, CONFIG.edge):
        near = cv2.dilate(robot.astype(np.uint8), np.ones((2 * pixels + 1,) * 2, np.uint8)) > 0
        clear = ~downscale_mask(near, factor)
        view = _View(small.camera, np.where(clear, small.depth, 0).astype(np.float64), pose)
        sights.append(_Sight(_raised_cells(values_in_mask(points, above & clear)), view))
    cells, nowhere = sights[0].cells, np.zeros(frame.depth.shape, np.bool_)
    if len(cells) < CONFIG.fewest:
        return SeenWalls(nowhere, nowhere)
    for likely in _likely_axes(cells):
        walls, axes = _find_walls(sights, likely)
        if walls and _holds_things(walls, axes, cells):
            break
    else:
        return SeenWalls(nowhere, nowhere)
    full, low = robot_frame_point_map(frame, table), max(CONFIG.lowest, CONFIG.deviations * table.residual)
    own = _pixels_near_walls(walls, axes, full, low, (CONFIG.margin, CONFIG.level))
    own = np.asarray(cv2.morphologyEx(own.astype(np.uint8), cv2.MORPH_CLOSE, np.ones((5, 5), np.uint8)), np.bool_)
    beside = cv2.distanceTransform((~robot).astype(np.uint8), cv2.DIST_L2, 5) < CONFIG.beside
    mixed = _pixels_near_walls(walls, axes, full, low, (CONFIG.mixed, CONFIG.mixed)) & beside
    return SeenWalls(own & ~robot, mixed & ~robot)


def _raised_cells(cloud: Array) -> Array:
    """(N, 3) x, y and greatest height of the cells of the table that something rises over; from (M, 3) points."""
    cloud = cloud[(cloud[:, 2] > CONFIG.raised) & (cloud[:, 2] < CONFIG.highest)]
    if not len(cloud):
        return np.zeros((0, 3))
    index = np.floor(cloud[:, :2] / CONFIG.cell).astype(np.int64)
    index -= index.min(axis=0)
    keys, owners = np.unique(index[:, 0] * (index[:, 1].max() + 1) + index[:, 1], return_inverse=True)
    tops = np.zeros(len(keys))
    np.maximum.at(tops, owners, cloud[:, 2])
    count = np.bincount(owners)
    middle = [np.bincount(owners, cloud[:, axis]) / count for axis in (0, 1)]
    return np.stack([*middle, tops], axis=1)


def _likely_axes(cells: Array) -> list[Array]:
    """(2, 2) each, the directions across the walls, the likeliest first: those in which outermost straight lines hold
    more than in any that is turned by a little. The picture's border cuts straight lines too."""
    yaws = np.deg2rad(np.arange(0, 90, CONFIG.turn))
    turned = [cells @ _widened(axes) for axes in axes_from_yaws(yaws)]
    scores = np.array([sum(_longest_line(local, *side)[1] for side in SIDES) for local in turned])
    beside = [np.roll(scores, shift) for shift in range(-CONFIG.apart_yaws, CONFIG.apart_yaws + 1) if shift]
    peaks = np.flatnonzero(scores >= np.max(beside, axis=0))
    best = peaks[np.argsort(-scores[peaks], kind="stable")][: CONFIG.hypotheses]
    return list(axes_from_yaws(yaws[best]))


def _widened(axes: Array) -> Array:
    """(3, 3) what turns rows of (N, 3) points into the bin's axes."""
    turn = np.eye(3)
    turn[:2, :2] = axes.T
    return turn


def _straight_lines(local: Array, axis: int, sign: float) -> tuple[Array, npt.NDArray[np.int64], Array]:
    """Lines along a side, from the innermost: where they lie across it, m outward; how many centimetres of each are
    occupied; and the share of all that lies beyond. ``local`` are (N, 3) cells in the bin's axes."""
    across, along = sign * local[:, axis], local[:, 1 - axis]
    bins = ((across - across.min()) / CONFIG.line).astype(np.int64)
    places = ((along - along.min()) / CONFIG.line).astype(np.int64)
    grid = np.zeros((bins.max() + 4, places.max() + 1), np.bool_)
    grid[bins, places] = True
    held = (grid[:-3] | grid[1:-2]).sum(axis=1)
    within = np.cumsum(np.bincount(bins, minlength=len(grid)))
    beyond = 1 - within[3:] / len(local)
    return across.min() + (np.arange(len(held)) + 1) * CONFIG.line, held, beyond


def _longest_line(local: Array, axis: int, sign: float) -> tuple[float, int]:
    """Of the lines along a side that hardly anything lies beyond, where the longest lies and its length, m and cm."""
    places, held, beyond = _straight_lines(local, axis, sign)
    held[beyond > CONFIG.outside] = 0
    best = int(np.argmax(held))
    return float(places[best]), int(held[best])


def _find_walls(sights: Sequence[_Sight], axes: Array) -> tuple[list[_Wall], Array]:
    """The walls of a bin, none where they do not make one; and the directions across them, (2, 2). In the later sights,
    nearer to the robot, hidden walls are looked for."""
    cells, view = sights[0].cells, sights[0].view
    local = cells @ _widened(axes)
    walls = _straight_walls(local, axes, view)
    for _ in range(CONFIG.rounds):
        if len(walls) < CONFIG.fewest_walls:
            return [], axes
        axes = axes_from_yaws(np.array([_turn(walls, local)]))[0] @ axes
        local = cells @ _widened(axes)
        walls = _straight_walls(local, axes, view)
    rims = {number: _slid_to_rim(_to_corners(wall, walls, axes, view), axes, view) for number, wall in walls.items()}
    walls = {number: wall for number, wall in walls.items() if _is_all_along(rims[number], axes, view)}
    if len(walls) < CONFIG.fewest_walls:
        return [], axes
    for sight in sights:
        walls |= _hidden_walls(walls, sight.cells @ _widened(axes), axes, sight.view)
    joined = _joined_walls(walls, axes, view)
    joined = [_slid_to_rim(wall, axes, view) for wall in joined]
    return (joined if _are_all_around(joined, local, axes, view) else []), axes


def _straight_walls(local: Array, axes: Array, view: _View) -> dict[int, _Wall]:
    """By side, the outermost lines of which the rims are level with each other, and seen all along."""
    level = _rim_level(local)
    found: dict[int, _Wall] = {}
    for number in range(len(SIDES)):
        walls = [_measure_wall(local, number, place, level) for place in _possible_places(local, number, level)]
        seen = {_length_seen(wall, axes, view): wall for wall in walls if wall is not None}
        if seen and max(seen) > CONFIG.few:
            found[number] = seen[max(seen)]
    return found


def _possible_places(local: Array, number: int, level: float) -> list[float]:
    """Where across a side rims at ``level`` may lie, m outward."""
    rim = local[np.abs(local[:, 2] - level) < CONFIG.level]
    if not len(rim):
        return []
    axis, sign = SIDES[number]
    places, held, _ = _straight_lines(rim, axis, sign)
    limit = np.quantile(sign * local[local[:, 2] > level / 2, axis], 1 - CONFIG.outside) - CONFIG.strip
    peaks = held == np.asarray(cv2.dilate(held.astype(np.float32), np.ones((5, 5), np.uint8))).ravel()
    return [float(place) for place in places[peaks & (held * CONFIG.line > CONFIG.short) & (places > limit)]]


def _measure_wall(local: Array, number: int, place: float, level: float) -> _Wall | None:
    """The wall with its rim at ``level`` at a place across a side; None if it is not long."""
    axis, sign = SIDES[number]
    across, along = sign * local[:, axis], local[:, 1 - axis]
    rim = (np.abs(local[:, 2] - level) < CONFIG.level) & (np.abs(across - place) < CONFIG.strip)
    rim &= np.abs(across - _straight(across, along, rim)) < CONFIG.thick / 2
    if len(np.unique(np.floor(along[rim] / CONFIG.line))) * CONFIG.line < CONFIG.short:
        return None
    inner, outer = np.percentile(across[rim], (10, 90))
    start, end = np.percentile(along[rim], (1, 99))
    return _Wall(number, float(inner), float(outer), float(start), float(end), level)


def _hidden_walls(walls: dict[int, _Wall], local: Array, axes: Array, view: _View) -> dict[int, _Wall]:
    """By side, walls of which the rim is hidden or beyond the picture: straight lines of what is lower, where the side
    that faces the camera is seen wherever nothing hides it, and no other wall is seen to go on beyond."""
    height = next(iter(walls.values())).height
    thick = float(np.median([wall.outer - wall.inner for wall in walls.values()]))
    low = local[local[:, 2] < height + CONFIG.level]
    eye = axes @ view.pose[:2, 3]
    found: dict[int, _Wall] = {}
    for number in set(range(len(SIDES))) - set(walls):
        axis, sign = SIDES[number]
        ends = [sign * (one.end if sign > 0 else one.start) for one in walls.values() if SIDES[one.side][0] != axis]
        for place in _outermost_places(low, number) if ends else []:
            inner = place if sign * eye[axis] < place else place - thick
            wall = _cornered(_Wall(number, inner, inner + thick, 0.0, 0.0, height), walls)
            seen, past, _ = view.look(_face(wall, place, axes))
            if seen.sum() > CONFIG.face and past.sum() <= CONFIG.few and max(ends) < wall.outer + CONFIG.margin:
                found[number] = wall
    return found


def _outermost_places(low: Array, number: int) -> list[float]:
    """Where across a side straight lines lie that hardly anything is beyond, m outward, the outermost last."""
    axis, sign = SIDES[number]
    across = sign * low[:, axis]
    places, held, beyond = _straight_lines(low, axis, sign)
    held[beyond > CONFIG.stray] = 0
    peaks = held == np.asarray(cv2.dilate(held.astype(np.float32), np.ones((3, 3), np.uint8))).ravel()
    near = [np.abs(across - place) < CONFIG.line for place in places[peaks & (held > CONFIG.columns)]]
    return [float(np.median(across[own])) for own in near]


def _face(wall: _Wall, place: float, axes: Array) -> Array:
    """(N, 3) points of a wall's side at a place across, robot frame, from its rim down to the lowest that is raised."""
    rim = _rim(replace(wall, inner=place, outer=place), axes, wall.start, wall.end)
    heights = np.arange(wall.height, CONFIG.raised, -CONFIG.line)
    return np.concatenate([np.column_stack([rim[:, :2], np.full(len(rim), height)]) for height in heights])


def _rim_level(local: Array) -> float:
    """The height at which most of what rises along the outermost lines ends. What hides a rim lets its wall end
    anywhere below it."""
    tops = np.concatenate([_tops_along_line(local, *side) for side in SIDES])
    alike = np.abs(tops[:, None] - tops) < CONFIG.level / 2
    return float(np.median(tops[alike[int(np.argmax(alike.sum(axis=1)))]]))


def _tops_along_line(local: Array, axis: int, sign: float) -> Array:
    """(N,) the greatest heights, m, in each occupied centimetre of the longest line along a side."""
    place, _ = _longest_line(local, axis, sign)
    own = np.abs(sign * local[:, axis] - place) < CONFIG.strip
    _, owners = np.unique(np.floor(local[own, 1 - axis] / CONFIG.line).astype(np.int64), return_inverse=True)
    tops = np.zeros(int(owners.max(initial=-1)) + 1)
    np.maximum.at(tops, owners, local[own, 2])
    return tops


def _straight(across: Array, along: Array, rim: Mask) -> Array:
    """(N,) where the line that most of the ``rim`` cells lie on is across, at (N,) places along it."""
    level, slope, own = float(np.median(across[rim])), 0.0, rim
    for _ in range(3):
        own = rim & (np.abs(across - level - slope * along) < CONFIG.thick / 2)
        if np.count_nonzero(own) < 3:
            break
        slope, level = (float(v) for v in np.polyfit(along[own], across[own], 1))
    return level + slope * along


def _turn(walls: dict[int, _Wall], local: Array) -> float:
    """By what angle, rad, the axes must turn to be along the walls."""
    turns: list[float] = []
    for wall in walls.values():
        axis, sign = SIDES[wall.side]
        across, along = local[:, axis], local[:, 1 - axis]
        own = np.abs(sign * across - wall.middle) < CONFIG.thick / 2
        own &= np.abs(local[:, 2] - wall.height) < CONFIG.level
        slope = float(np.polyfit(along[own], across[own], 1)[0])
        turns.append(-slope if axis == 0 else slope)
    # The angle of a line is known the better, the longer it is: its variance falls with the third power of the length.
    return float(np.average(turns, weights=[(wall.end - wall.start) ** 3 for wall in walls.values()]))


def _rim(wall: _Wall, axes: Array, start: float, end: float) -> Array:
    """(N, 3) points along the middle of a wall's rim, robot frame."""
    axis, sign = SIDES[wall.side]
    along = np.arange(start, end, CONFIG.line)
    across = np.full(len(along), sign * wall.middle)
    local = np.stack([across, along] if axis == 0 else [along, across], axis=1)
    return np.column_stack([local @ axes, np.full(len(along), wall.height)])


def _length_seen(wall: _Wall, axes: Array, view: _View) -> int:
    """How many centimetres of a rim are seen; 0 if it is not there wherever nothing hides it."""
    seen, past, _ = view.look(_rim(wall, axes, wall.start, wall.end))
    return int(seen.sum()) if seen.sum() > CONFIG.seen * (seen | past).sum() else 0


def _joined_walls(walls: dict[int, _Wall], axes: Array, view: _View) -> list[_Wall]:
    """The walls from corner to corner; where one ends in plain sight and no other meets it, another one is assumed."""
    for wall in list(walls.values()):
        for last, sign in ((False, -1.0), (True, 1.0)):
            other = 2 * (1 - SIDES[wall.side][0]) + int(last)
            end = wall.end if last else wall.start
            if other not in walls and _ends_in_sight(wall, end, sign, axes, view):
                thick = wall.outer - wall.inner
                walls[other] = _Wall(other, sign * end - thick, sign * end, 0.0, 0.0, wall.height)
    return [_to_corners(wall, walls, axes, view) for wall in walls.values()]


def _slid_to_rim(wall: _Wall, axes: Array, view: _View) -> _Wall:
    """The wall, slid across by a little to where most of its rim is seen if the camera seems to look past it: a thin
    rim is missed by millimetres."""
    _, past, _ = view.look(_rim(wall, axes, wall.start, wall.end))
    if past.sum() <= CONFIG.few:
        return wall
    moved = [replace(wall, inner=wall.inner + by, outer=wall.outer + by) for by in CONFIG.slides]
    looks = [view.look(_rim(one, axes, one.start, one.end)) for one in moved]
    return moved[int(np.argmax([int(seen.sum()) - int(past.sum()) for seen, past, _ in looks]))]


def _ends_in_sight(wall: _Wall, end: float, sign: float, axes: Array, view: _View) -> bool:
    """Whether the camera looks past where a wall would go on."""
    near, far = end + sign * CONFIG.gap, end + sign * (CONFIG.gap + CONFIG.free)
    _, past, _ = view.look(_rim(wall, axes, min(near, far), max(near, far)))
    return bool(past.mean() > 0.5)


def _cornered(wall: _Wall, walls: dict[int, _Wall]) -> _Wall:
    """A wall that reaches to the outsides of those that it meets, and beyond the picture where it meets none."""
    first = 2 * (1 - SIDES[wall.side][0])
    low, high = walls.get(first), walls.get(first + 1)
    start = -low.outer if low else wall.start - CONFIG.open
    end = high.outer if high else wall.end + CONFIG.open
    return _Wall(wall.side, wall.inner, wall.outer, start, end, wall.height)


def _to_corners(wall: _Wall, walls: dict[int, _Wall], axes: Array, view: _View) -> _Wall:
    """A wall that reaches to those that it meets; where none is found, to where the camera looks past it: it ends
    there, or behind what hides its corner."""
    whole = _cornered(wall, walls)
    if wall.start == wall.end:  # it is not measured
        return whole
    start, end = _reach_along(-1, -whole.start, wall, axes, view), _reach_along(1, whole.end, wall, axes, view)
    return replace(whole, start=-start, end=end)


def _reach_along(sign: int, far: float, wall: _Wall, axes: Array, view: _View) -> float:
    """How far along it, m the way ``sign`` points, a wall is not seen past: at most ``far``."""
    near = wall.end if sign > 0 else -wall.start
    if far < near + CONFIG.open:  # another one is there
        return far
    rim = _rim(wall, axes, *((near, far) if sign > 0 else (-far, -near)))[::sign]
    _, past, _ = view.look(rim)
    return near + int(past.argmax()) * CONFIG.line if past.any() else far


def _are_all_around(walls: Sequence[_Wall], local: Array, axes: Array, view: _View) -> bool:
    """Whether the walls are seen wherever they are not hidden, and hardly anything that rises to half their height is
    beyond them: what is lower may be the robot's blurred edge."""
    total = sum(int(view.look(_rim(wall, axes, wall.start, wall.end))[0].sum()) for wall in walls)
    around = all(_is_all_along(wall, axes, view) for wall in walls) and total * CONFIG.line > CONFIG.long
    tall = local[local[:, 2] > walls[0].height / 2]
    return around and _beyond(walls, tall[:, :2]).mean() < CONFIG.outside


def _is_all_along(wall: _Wall, axes: Array, view: _View) -> bool:
    """Whether a rim is seen wherever it is not hidden."""
    seen, past, _ = view.look(_rim(wall, axes, wall.start, wall.end))
    return bool(past.sum() <= CONFIG.few or seen.sum() >= CONFIG.seen * (seen | past).sum())


def _beyond(walls: Sequence[_Wall], local: Array) -> Mask:
    """(...,) which of the (..., 2) points in the bin's axes are outside of a wall."""
    out = np.zeros(local.shape[:-1], np.bool_)
    for wall in walls:
        axis, sign = SIDES[wall.side]
        out |= sign * local[..., axis] > wall.outer + CONFIG.strip
    return out


def _holds_things(walls: Sequence[_Wall], axes: Array, cells: Array) -> bool:
    """Whether several things stand apart between the walls, seen from above: a box with one in it is an object."""
    local = cells[:, :2] @ axes.T
    inside = np.ones(len(cells), np.bool_)
    for wall in walls:
        axis, sign = SIDES[wall.side]
        inside &= sign * local[:, axis] < wall.inner - CONFIG.strip
    if not inside.any():
        return False
    places = np.floor((local[inside] - local[inside].min(axis=0)) / CONFIG.line).astype(np.int64)
    grid = np.zeros(places.max(axis=0) + 1, np.uint8)
    grid[places[:, 0], places[:, 1]] = 1
    return int(label_connected_components(grid, CONFIG.thing).max()) >= CONFIG.things


def _pixels_near_walls(
    walls: Sequence[_Wall], axes: Array, points: Array, low: float, margins: tuple[float, float]
) -> Mask:
    """(H, W) the pixels of which the ``points`` (H, W, 3) are higher than ``low`` and within ``margins`` (m, beside it
    and over its rim) of a wall."""
    local = points[..., :2] @ axes.T
    found = np.zeros(points.shape[:2], np.bool_)
    margin, over = margins
    for wall in walls:
        axis, sign = SIDES[wall.side]
        across, along = sign * local[..., axis], local[..., 1 - axis]
        own = (across > wall.inner - margin) & (across < wall.outer + margin)
        own &= (along > wall.start - margin) & (along < wall.end + margin)
        found |= own & (points[..., 2] > low) & (points[..., 2] < wall.height + over)
    return found
