"""Round objects: axis of revolution, profile by depth and outline, inner wall and floor if hollow, handle."""

from dataclasses import dataclass, replace
from itertools import pairwise

import cv2
import numpy as np
import numpy.typing as npt

from grs_agents.perception.shapes.configuration import DEFAULT
from grs_agents.perception.shapes.mesh_simplification import simplify_closed_mesh
from grs_agents.perception.shapes.object_crop import ObjectCrop, connected_pieces, dilate, sample, signed_edge_distance
from grs_agents.perception.shapes.surface_nets import (
    Faces,
    keep_large_pieces,
    mesh_zero_level,
    smooth_grid,
    smooth_mesh,
)
from grs_agents.perception.types import Array, Mask

CONFIG = DEFAULT.lathe
REVOLUTION = DEFAULT.revolution
OUTLINE = DEFAULT.outline
HANDLE = DEFAULT.handle
Ints = npt.NDArray[np.int64]


@dataclass(frozen=True)
class Axis:
    """An upright axis of revolution and its support."""

    x: float  # position, object frame, m
    y: float
    share: float  # of the seen points that lie on the turned surface with a radial normal
    azimuth: float  # angle around the axis that these points cover, rad


@dataclass(frozen=True)
class TurnedSolid:
    """A solid of revolution, object frame, m."""

    axis: Axis
    profile: Array  # (P, 2) radius and height, from the middle of the foot outwards, over the rim to the middle again
    outer: Array  # (S, 2) height and outer radius
    walls: Array | None  # (N, 3) inner radius, outer radius, height; ``None`` for a full solid

    def outer_radius(self, heights: Array) -> Array:
        """(N,) of the body at heights (N,), m."""
        return np.interp(heights, self.outer[:, 0], self.outer[:, 1])

    @property
    def top(self) -> float:
        """Height of the rim, m."""
        return float(self.outer[-1, 0])


def fit_revolution_axis(crop: ObjectCrop) -> Axis | None:
    """The upright axis of the best surface of revolution; ``None`` with too few steep normals."""
    flat = np.linalg.norm(crop.normals[:, :2], axis=1)
    steep = flat > REVOLUTION.steep
    if np.count_nonzero(steep) < REVOLUTION.fewest:
        return None
    points, heights = crop.points[steep, :2], crop.points[steep, 2]
    normals = crop.normals[steep, :2] / flat[steep, None]
    height = max(float(np.ptp(heights)), 1e-3)
    slices = np.minimum((heights - heights.min()) / height * REVOLUTION.slices, REVOLUTION.slices - 1).astype(np.int64)
    center = _refine_center(points, normals, slices, _point_nearest_to_normals(points, normals))
    radii, expected, _ = _slice_radii(points, normals, slices, center)
    off = points - center
    radial = np.abs((off * normals).sum(axis=1)) / radii > REVOLUTION.radial
    on = radial & (np.abs(radii - expected) < np.maximum(2 * crop.noise, REVOLUTION.out_of_round * expected))
    sectors = np.floor(np.arctan2(off[on, 1], off[on, 0]) / (2 * np.pi) * REVOLUTION.sectors)
    covered = len(np.unique(sectors)) / REVOLUTION.sectors * 2 * np.pi
    return Axis(float(center[0]), float(center[1]), float(on.mean()), covered)


def _point_nearest_to_normals(points: Array, normals: Array) -> Array:
    """(2,) point nearest to the lines (N, 2) along the normals, by iteratively reweighted least squares."""
    across = np.stack([normals[:, 1], -normals[:, 0]], axis=1)
    offsets, weights = (across * points).sum(axis=1), np.ones(len(points))
    center = points.mean(axis=0)
    for _ in range(REVOLUTION.rounds):
        weighted = across * (weights**2)[:, None]
        center = np.asarray(np.linalg.solve(weighted.T @ across + 1e-9 * np.eye(2), weighted.T @ offsets), np.float64)
        off = across @ center - offsets
        scale = max(REVOLUTION.line_distance, 1.5 * float(np.median(np.abs(off))))
        weights = 1 / (1 + (off / scale) ** 2)
    return center


def _slice_radii(points: Array, normals: Array, slices: Ints, center: Array) -> tuple[Array, Array, Ints]:
    """(N,) each: a point's radius, the median radius of its group, and the group. A group is a slice of the height and
    a side of the wall, outer or inner."""
    off = points - center
    radii = np.linalg.norm(off, axis=1) + 1e-9
    group = 2 * slices + ((off * normals).sum(axis=1) < 0)
    order = np.lexsort((radii, group))
    first = np.searchsorted(group[order], np.arange(2 * REVOLUTION.slices + 1))
    middle = np.minimum((first[:-1] + first[1:]) // 2, len(radii) - 1)
    return radii, radii[order][middle][group], group


def _refine_center(points: Array, normals: Array, slices: Ints, center: Array) -> Array:
    """(2,) center by robust Gauss-Newton; residuals are the deviations from the radius of each group of points."""
    for _ in range(REVOLUTION.rounds):
        radii, expected, group = _slice_radii(points, normals, slices, center)
        error = radii - expected
        weight = 1 / (1 + (error / REVOLUTION.radius_error) ** 2)
        outward = (points - center) / radii[:, None]
        total = np.bincount(group, weights=weight, minlength=2 * REVOLUTION.slices) + 1e-12
        columns: list[Array] = []
        for values in (outward[:, 0], outward[:, 1], error):  # the radius of each group is eliminated
            mean = np.bincount(group, weights=weight * values, minlength=2 * REVOLUTION.slices) / total
            columns.append(values - mean[group])
        slope, left = np.stack(columns[:2], axis=1), columns[2]
        step = np.asarray(
            np.linalg.solve(slope.T @ (slope * weight[:, None]) + 1e-6 * np.eye(2), slope.T @ (weight * left)),
            np.float64,
        )
        center = center + np.clip(step, -0.01, 0.01)
    return center


@dataclass(frozen=True)
class _Polar:
    """Cylindrical coordinates of the seen points about an axis."""

    radius: Array  # (N,)
    height: Array
    outward: Array  # (N,) radial component of the normal, -1..1
    upward: Array


def _polar_coordinates_about_axis(crop: ObjectCrop, axis: Axis) -> _Polar:
    off = crop.points[:, :2] - (axis.x, axis.y)
    radius = np.linalg.norm(off, axis=1) + 1e-9
    outward = (off * crop.normals[:, :2]).sum(axis=1) / radius
    return _Polar(radius, crop.points[:, 2], outward, crop.normals[:, 2])


def measure_turned_profile(crop: ObjectCrop, axis: Axis) -> TurnedSolid | None:
    """The solid of revolution about an axis; ``None`` with too little of its side in view."""
    polar = _polar_coordinates_about_axis(crop, axis)
    steep = np.abs(polar.upward) < 0.95
    high = polar.height[steep] if steep.sum() > CONFIG.fewest else polar.height
    heights = np.linspace(0.0, max(float(np.percentile(high, 98)), CONFIG.lowest), CONFIG.slices)
    largest = 1.5 * float(np.percentile(polar.radius, 98)) + 0.01
    axis = _center_axis_in_outline(axis, crop, _silhouette_radii_by_side(crop, axis, heights, largest))
    polar = _polar_coordinates_about_axis(crop, axis)
    outer, inner = _radii_of_walls(polar, heights)
    # Hollow: inner walls are seen well below the rim, and no lid.
    widest = np.nanmax(np.concatenate([inner[-6:], outer[-6:], [0.0]]))
    middle = polar.height[polar.radius < 0.5 * widest]
    lid = np.count_nonzero(middle > heights[-1] - CONFIG.deep)
    hollow = bool(
        np.isfinite(inner[CONFIG.slices // 2 :]).sum() >= CONFIG.inner_slices
        and lid < max(0.5 * len(middle), CONFIG.floor_share * len(polar.height))
    )
    if hollow:  # a lid's height is measured well, a rim's is not
        rim = float(np.nanmin([*_silhouette_radii_by_side(crop, axis, heights[-1:], largest)[0], largest]))
        heights = heights * (_refine_rim_height(crop, axis, rim, heights[-1]) / heights[-1])
        outer, inner = _radii_of_walls(polar, heights)
        if np.isfinite(outer).sum() < np.isfinite(inner).sum():
            # A bowl seen from inside: flying pixels lie farther out than its outer wall.
            sound, wall = _sound_wall_thickness(outer, inner)
            radii = np.where(sound, outer, inner + wall)
            known = np.isfinite(radii)
            outer = np.asarray(np.interp(heights, heights[known], radii[known]), np.float64)
    if np.isfinite(outer).sum() < CONFIG.fewest_slices:
        return None
    sides = _silhouette_radii_by_side(crop, axis, heights, largest)
    fitted = _combine_depth_and_outline_radii(outer, sides, crop.noise)
    known = np.isfinite(fitted)
    radii = _smooth_profile_values(np.interp(heights, heights[known], fitted[known]))
    axis = _move_axis_to_measured_depth(axis, crop, heights, radii, inner)
    side = np.stack([radii, heights], axis=1)
    if hollow:
        walls = _wall_radii_by_height(polar, heights, radii, inner)
        inside = np.concatenate([walls[::-1, [0, 2]], [(0.0, walls[0, 2])]])
    else:
        walls = None
        rings: list[tuple[float, float]] = []
        for radius in np.linspace(0.9, 0.1, 5) * side[-1, 0]:
            near = polar.height[np.abs(polar.radius - radius) < 0.12 * side[-1, 0]]
            near = near[near > side[-1, 1] - CONFIG.deep]
            if len(near) >= CONFIG.fewest_points:
                rings.append((float(radius), float(np.median(near))))
        inside = np.array([*rings, (0.0, rings[-1][1] if rings else float(side[-1, 1]))])
    profile = _simplify_profile(np.concatenate([np.zeros((1, 2)), side, inside]))
    return TurnedSolid(axis, profile, side[:, ::-1], walls)


def _radii_of_walls(polar: _Polar, heights: Array) -> tuple[Array, Array]:
    """(S,) median radius by height of the outer wall, and of the inner wall; NaN with too few points."""
    reach = 0.75 * heights[1]
    walls: list[Array] = []
    for facing in (polar.outward > CONFIG.sideways, polar.outward < -CONFIG.sideways):
        found = np.full(len(heights), np.nan)
        for number, height in enumerate(heights):
            radii = polar.radius[facing & (np.abs(polar.height - height) < reach)]
            if len(radii) >= CONFIG.fewest_points:
                found[number] = np.median(radii)
        walls.append(found)
    return walls[0], walls[1]


def _move_axis_to_measured_depth(axis: Axis, crop: ObjectCrop, heights: Array, radii: Array, inner: Array) -> Axis:
    """The axis shifted along the view, by least squares, to align walls of these radii with the measured points."""
    polar = _polar_coordinates_about_axis(crop, axis)
    away = np.array([axis.x, axis.y]) - crop.eye[:2]
    away /= np.linalg.norm(away)
    along = (crop.points[:, :2] - (axis.x, axis.y)) @ away / polar.radius
    known = np.isfinite(inner)
    within = np.interp(polar.height, heights[known], inner[known]) if known.any() else polar.radius
    side = np.abs(polar.outward) > CONFIG.sideways
    off = polar.radius - np.where(polar.outward > 0, np.interp(polar.height, heights, radii), within)
    side &= np.abs(off) < CONFIG.astray
    if not side.any():
        return axis
    shift = float((along * off)[side].sum() / max((along[side] ** 2).sum(), 1e-9)) * away
    return replace(axis, x=axis.x + float(shift[0]), y=axis.y + float(shift[1]))


def _sound_wall_thickness(outer: Array, inner: Array) -> tuple[Mask, float]:
    """(S,) heights at which both radii belong to the same wall, and its median thickness there, m."""
    with np.errstate(invalid="ignore"):
        thick = outer - inner
        sound = (thick > 0) & (thick < CONFIG.thickest)
    wall = float(np.clip(np.median(thick[sound]), *CONFIG.wall)) if sound.any() else CONFIG.usual_wall
    return sound, wall


def _wall_radii_by_height(polar: _Polar, heights: Array, radii: Array, inner: Array) -> Array:
    """(N, 3) inner radius, outer radius and height from the floor to the rim."""
    sound, wall = _sound_wall_thickness(radii, inner)
    inside = np.where(sound, inner, radii - wall)
    inside = np.minimum(_smooth_profile_values(inside), radii - CONFIG.wall[0])
    middle = (polar.radius < 0.4 * radii[-1]) & (polar.upward > CONFIG.level)
    floor = float(np.median(polar.height[middle])) if middle.mean() > CONFIG.floor_share else wall
    floor = float(np.clip(floor, CONFIG.wall[0], heights[-1] - CONFIG.deep))
    levels = np.concatenate([[floor], heights[heights > floor + 0.25 * heights[1]]])
    inside = np.maximum(np.interp(levels, heights, inside), CONFIG.wall[0])
    return np.stack([inside, np.interp(levels, heights, radii), levels], axis=1)


def _smooth_profile_values(values: Array) -> Array:
    return np.convolve(np.pad(values, 1, mode="edge"), [0.25, 0.5, 0.25], "valid")


def _simplify_profile(profile: Array) -> Array:
    """The profile without nearly collinear points. Long sides are subdivided, and corners get points beside them: else
    the texture would be smeared around the corner."""
    scaled = (profile * 1e5).astype(np.int32).reshape(-1, 1, 2)
    kept = cv2.approxPolyDP(scaled, CONFIG.bend * 1e5, False).reshape(-1, 2) / 1e5
    longest = CONFIG.longest * float(np.ptp(profile, axis=0).max())
    steps = np.diff(kept, axis=0)
    lengths = np.linalg.norm(steps, axis=1)
    turns = (steps[1:] * steps[:-1]).sum(axis=1) < CONFIG.sharp * lengths[1:] * lengths[:-1]
    sharp = np.concatenate([[False], turns, [False]])
    found = [kept[0]]
    for number, (start, end) in enumerate(pairwise(kept)):
        parts = max(1, int(np.ceil(lengths[number] / longest)))
        shares = set((np.arange(1, parts + 1) / parts).tolist())
        near = CONFIG.corner / max(float(lengths[number]), 1e-9)
        if near < 0.3 / parts:
            shares |= {near} if sharp[number] else set()
            shares |= {1 - near} if sharp[number + 1] else set()
        found += [start + (end - start) * share for share in sorted(shares)]
    return np.array(found)


def _silhouette_radii_by_side(crop: ObjectCrop, axis: Axis, heights: Array, largest: float) -> Array:
    """(S, 2) largest radius at each height whose ring stays inside the mask on the left and on the right of the view,
    m; NaN if a nearer surface occludes that side."""
    to_eye = crop.eye[:2] - (axis.x, axis.y)
    distance, toward = float(np.linalg.norm(to_eye)), float(np.arctan2(to_eye[1], to_eye[0]))
    radii = np.arange(OUTLINE.step, largest + OUTLINE.step, OUTLINE.step)
    turn = np.arccos(np.minimum(radii / distance, 1.0))  # to the tangent point of the ring, as seen
    angles = toward + turn[:, None] * (1, -1)
    places = np.empty((len(heights), len(radii), 2, 3))
    places[..., 0] = axis.x + radii[:, None] * np.cos(angles)
    places[..., 1] = axis.y + radii[:, None] * np.sin(angles)
    places[..., 2] = heights[:, None, None]
    outside = _pixel_distance_outside_mask(crop, places.reshape(-1, 3)).reshape(places.shape[:3])
    left = outside > 0
    first = np.where(left.any(axis=1), left.argmax(axis=1), len(radii) - 1)
    hidden = np.isnan(np.take_along_axis(outside, first[:, None], axis=1)[:, 0])
    return np.where(hidden, np.nan, radii[first])


def _pixel_distance_outside_mask(crop: ObjectCrop, places: Array) -> Array:
    """(N,) signed distance of points (N, 3) to the mask's edge, pixels, negative inside; NaN if occluded."""
    column, row, depth = crop.project(places)
    outside = sample(crop.edge, column, row, cv2.INTER_LINEAR, 50.0)
    measured = sample(crop.measured, column, row, cv2.INTER_NEAREST, 0.0)
    return np.where((outside > 0) & (measured > 0) & (measured < depth - OUTLINE.nearer), np.nan, outside)


def _center_axis_in_outline(axis: Axis, crop: ObjectCrop, sides: Array) -> Axis:
    """The axis shifted across the view to the middle between both sides of the outline, if the heights agree."""
    off = (sides[:, 0] - sides[:, 1]) / 2
    off = off[np.abs(off) < OUTLINE.off_center]  # a handle is farther off
    if len(off) < OUTLINE.fewest or np.ptp(np.percentile(off, [25, 75])) > OUTLINE.agreed:
        return axis
    to_eye = crop.eye[:2] - (axis.x, axis.y)
    across = np.array([-to_eye[1], to_eye[0]]) / np.linalg.norm(to_eye)
    shift = float(np.median(off)) * across
    return replace(axis, x=axis.x + float(shift[0]), y=axis.y + float(shift[1]))


def _combine_depth_and_outline_radii(measured: Array, sides: Array, noise: float) -> Array:
    """(S,) radius by height, half-way between depth (S,), NaN if unknown, and outline (S, 2): masks are as often too
    wide as depth ends too early. Without depth the outline alone counts."""
    with np.errstate(invalid="ignore"):
        outline = np.fmin(sides[:, 0], sides[:, 1])
        wider = outline - measured
        off = wider[np.abs(wider) < OUTLINE.near + 2 * noise]
    half = float(np.median(off)) / 2 if len(off) else 0.0
    return np.fmin(np.where(np.isnan(measured), outline - half, measured + half), outline)


def _refine_rim_height(crop: ObjectCrop, axis: Axis, radius: float, height: float) -> float:
    """The height of a rim of ``radius``, m: half-way between the measured ``height`` and the upper end of its far side
    in the mask."""
    away = np.array([axis.x, axis.y]) - crop.eye[:2]
    far = (axis.x, axis.y) + radius * away / np.linalg.norm(away)
    reach = OUTLINE.near + 2 * crop.noise
    heights = np.arange(height - reach, height + reach, OUTLINE.step / 2)
    outside = _pixel_distance_outside_mask(crop, np.column_stack([np.broadcast_to(far, (len(heights), 2)), heights]))
    if np.isnan(outside).any() or not (outside[0] <= 0 < outside[-1]):
        return height
    return (height + float(heights[np.argmax(outside > 0)])) / 2


def mesh_turned_solid(turned: TurnedSolid, most_faces: int) -> tuple[Array, Faces]:
    """The closed mesh of a turned solid, object frame."""
    line = turned.profile[1:-1]
    around = int(np.clip(most_faces // (2 * (len(line))), *CONFIG.around))
    angles = np.arange(around) * 2 * np.pi / around
    rings = np.empty((len(line), around, 3))
    rings[..., 0] = turned.axis.x + np.outer(line[:, 0], np.cos(angles))
    rings[..., 1] = turned.axis.y + np.outer(line[:, 0], np.sin(angles))
    rings[..., 2] = line[:, 1, None]
    ends = [(turned.axis.x, turned.axis.y, float(turned.profile[end, 1])) for end in (0, -1)]
    vertices = np.concatenate([rings.reshape(-1, 3), ends])
    index = np.arange(len(line) * around).reshape(len(line), around)
    after = np.roll(index, -1, axis=1)
    a, b, c, d = (part.ravel() for part in (index[:-1], after[:-1], after[1:], index[1:]))
    foot, top = len(vertices) - 2, len(vertices) - 1
    fans = [
        np.stack([np.full(around, foot), after[0], index[0]], axis=1),
        np.stack([np.full(around, top), index[-1], after[-1]], axis=1),
    ]
    return vertices, np.concatenate([np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1), *fans])


def mesh_visible_handle(crop: ObjectCrop, turned: TurnedSolid, most_faces: int) -> tuple[Array, Faces] | None:
    """The closed mesh of the handle; ``None`` without one, or for a handle seen edge on.

    A handle is the largest piece of the mask beside the turned body, extruded in an upright plane through the axis.
    """
    if turned.top < HANDLE.slender * 2 * float(turned.outer[:, 1].max()):
        return None
    body = dilate(crop.render_depth(*mesh_turned_solid(turned, 800)) > 0, 5)
    pieces = connected_pieces(crop.mask & ~body, HANDLE.fewest)
    if not pieces:
        return None
    piece = max(pieces, key=np.count_nonzero)
    reach = cv2.distanceTransform((~body).astype(np.uint8), cv2.DIST_L2, 5)[piece].max()
    if reach * float(np.median(crop.depth[piece])) / crop.focal[0] <= HANDLE.reach:
        return None
    # The azimuth of the handle follows from its depth if measured; else it is square to the view.
    eye = crop.eye[:2] - (turned.axis.x, turned.axis.y)
    toward = float(np.arctan2(eye[1], eye[0]))
    column = float(np.nonzero(piece)[1].mean())
    middle = crop.project(np.array([[turned.axis.x, turned.axis.y, turned.top / 2]]))[0][0]
    # The photo's right is on the left, seen from the object.
    azimuth = toward + (np.pi / 2 if column > middle else -np.pi / 2)
    points = crop.lift(crop.depth)[piece & (crop.measured > 0)] - (turned.axis.x, turned.axis.y, 0.0)
    radius = np.linalg.norm(points[:, :2], axis=1)
    far = points[radius > turned.outer_radius(points[:, 2]) + 0.5 * HANDLE.reach]
    if len(far) >= HANDLE.fewest:
        measured = float(np.arctan2(far[:, 1].sum(), far[:, 0].sum()))
        if abs(float(np.angle(np.exp(1j * (measured - azimuth))))) >= HANDLE.square:
            return None
        azimuth = measured
    return _mesh_handle_strip(crop, turned, dilate(piece, 7) & crop.mask, azimuth, most_faces)


def _mesh_handle_strip(
    crop: ObjectCrop, turned: TurnedSolid, strip: Mask, azimuth: float, most_faces: int
) -> tuple[Array, Faces] | None:
    """Mesh of the mask's ``strip`` projected onto the upright plane through the axis, with rounded edges."""
    out = np.array([np.cos(azimuth), np.sin(azimuth), 0.0])
    side = np.array([-out[1], out[0], 0.0])
    base = np.array([turned.axis.x, turned.axis.y, 0.0])
    widest = float(turned.outer[:, 1].max()) + HANDLE.longest
    step = HANDLE.step
    radii = np.arange(0.5 * float(turned.outer[:, 1].min()), widest, step)
    heights = np.arange(-2 * step, turned.top + 4 * step, step)
    plane = radii[:, None, None] * out + heights[None, :, None] * np.array([0.0, 0.0, 1.0]) + base
    column, row, _ = crop.project(plane.reshape(-1, 3))
    inside = sample(signed_edge_distance(strip), column, row, cv2.INTER_LINEAR, 50.0).reshape(plane.shape[:2]) < 0
    inside &= radii[:, None] > turned.outer_radius(heights) - HANDLE.sunk
    pieces = connected_pieces(np.asarray(inside), HANDLE.fewest)
    if not pieces:
        return None
    inside = max(pieces, key=np.count_nonzero)
    within = cv2.distanceTransform(inside.astype(np.uint8), cv2.DIST_L2, 5) * step
    beyond = cv2.distanceTransform((~inside).astype(np.uint8), cv2.DIST_L2, 5) * step
    half = float(np.clip(np.percentile(within[inside], 85), *HANDLE.half_thickness))
    across = np.arange(-half - 2 * step, half + 2.5 * step, step)
    edge = np.maximum(beyond - within + half, 0)
    values = np.hypot(edge[:, None, :], across[None, :, None]) - half
    vertices, faces = mesh_zero_level(smooth_grid(values), np.zeros(3), 1.0)
    vertices, faces = keep_large_pieces(vertices, faces, 0.2)
    vertices = smooth_mesh(vertices, faces, HANDLE.smoothing) * step
    vertices, faces = simplify_closed_mesh(vertices, faces, most_faces)
    local = vertices + np.array([radii[0], across[0], heights[0]])  # radius, across, height: a right-handed frame
    return base + local[:, :1] * out + local[:, 1:2] * side + local[:, 2:] * (0.0, 0.0, 1.0), faces
