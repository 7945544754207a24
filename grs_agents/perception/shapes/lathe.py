"""Round things: a profile turned about an upright axis, with an inner wall and a floor where one can look in."""

from dataclasses import dataclass, replace
from itertools import pairwise

import cv2
import numpy as np

from grs_agents.perception.shapes.configuration import DEFAULT
from grs_agents.perception.shapes.observation import Observation
from grs_agents.perception.shapes.revolution import Axis
from grs_agents.perception.shapes.surface_nets import Faces
from grs_agents.perception.shapes.turned_outline import (
    center_axis_in_outline,
    combine_depth_and_outline_radii,
    refine_rim_height,
    silhouette_radii_by_side,
)
from grs_agents.perception.types import Array, Mask

CONFIG = DEFAULT.lathe


@dataclass(frozen=True)
class TurnedSolid:
    """A turned solid."""

    axis: Axis
    profile: Array  # (P, 2) radius and height, from the middle of the foot outwards, over the rim to the middle again
    outer: Array  # (S, 2) height and outer radius
    walls: Array | None  # (N, 3) inner radius, outer radius, height; of a hollow one

    def outer_radius(self, heights: Array) -> Array:
        """(N,) of the body at heights (N,), m."""
        return np.interp(heights, self.outer[:, 0], self.outer[:, 1])

    @property
    def top(self) -> float:
        """Height of the rim, m."""
        return float(self.outer[-1, 0])


@dataclass(frozen=True)
class _Polar:
    """The seen points about an axis."""

    radius: Array  # (N,)
    height: Array
    outward: Array  # (N,) how far the normal looks away from the axis, -1..1
    upward: Array


def measure_turned_profile(seen: Observation, axis: Axis) -> TurnedSolid | None:
    """The profile of what turns about an axis; ``None`` where hardly any of its side is seen."""
    heights = np.linspace(0.0, _rim_height(_polar_coordinates_about_axis(seen, axis)), CONFIG.slices)
    largest = 1.5 * float(np.percentile(_polar_coordinates_about_axis(seen, axis).radius, 98)) + 0.01
    axis = center_axis_in_outline(axis, seen, silhouette_radii_by_side(seen, axis, heights, largest))
    polar = _polar_coordinates_about_axis(seen, axis)
    outer, inner = _radii_of_walls(polar, heights)
    hollow = _is_inside_visible(polar, heights[-1], inner, outer)
    if hollow:  # a lid's height is measured well, a rim's is not
        rim = float(np.nanmin([*silhouette_radii_by_side(seen, axis, heights[-1:], largest)[0], largest]))
        heights = heights * (refine_rim_height(seen, axis, rim, heights[-1]) / heights[-1])
        outer, inner = _radii_of_walls(polar, heights)
        outer = _outer_radii_of_hollow_solid(outer, inner, heights)
    if np.isfinite(outer).sum() < CONFIG.fewest_slices:
        return None
    fitted = combine_depth_and_outline_radii(outer, silhouette_radii_by_side(seen, axis, heights, largest), seen.noise)
    known = np.isfinite(fitted)
    radii = _smooth_profile_values(np.interp(heights, heights[known], fitted[known]))
    axis = _move_axis_to_measured_depth(axis, seen, heights, radii, inner)
    side = np.stack([radii, heights], axis=1)
    foot = np.zeros((1, 2))
    if not hollow:
        return TurnedSolid(
            axis,
            _simplify_profile(np.concatenate([foot, side, _find_profile_of_top(polar, side[-1])])),
            side[:, ::-1],
            None,
        )
    walls = _wall_radii_by_height(polar, heights, radii, inner)
    cavity = np.concatenate([walls[::-1, [0, 2]], [(0.0, walls[0, 2])]])
    return TurnedSolid(axis, _simplify_profile(np.concatenate([foot, side, cavity])), side[:, ::-1], walls)


def _radii_of_walls(polar: _Polar, heights: Array) -> tuple[Array, Array]:
    """(S,) radius by height of what looks outwards, and of what looks inwards; NaN where there is too little."""
    return (
        _radius_by_height(polar, heights, polar.outward > CONFIG.sideways),
        _radius_by_height(polar, heights, polar.outward < -CONFIG.sideways),
    )


def _move_axis_to_measured_depth(axis: Axis, seen: Observation, heights: Array, radii: Array, inner: Array) -> Axis:
    """The axis moved along the view until walls of these radii lie where they were measured."""
    polar = _polar_coordinates_about_axis(seen, axis)
    away = np.array([axis.x, axis.y]) - seen.eye[:2]
    away /= np.linalg.norm(away)
    along = (seen.points[:, :2] - (axis.x, axis.y)) @ away / polar.radius
    known = np.isfinite(inner)
    within = np.interp(polar.height, heights[known], inner[known]) if known.any() else polar.radius
    side = np.abs(polar.outward) > CONFIG.sideways
    off = polar.radius - np.where(polar.outward > 0, np.interp(polar.height, heights, radii), within)
    side &= np.abs(off) < CONFIG.astray
    if not side.any():
        return axis
    shift = float((along * off)[side].sum() / max((along[side] ** 2).sum(), 1e-9)) * away
    return replace(axis, x=axis.x + float(shift[0]), y=axis.y + float(shift[1]))


def _polar_coordinates_about_axis(seen: Observation, axis: Axis) -> _Polar:
    off = seen.points[:, :2] - (axis.x, axis.y)
    radius = np.linalg.norm(off, axis=1) + 1e-9
    outward = (off * seen.normals[:, :2]).sum(axis=1) / radius
    return _Polar(radius, seen.points[:, 2], outward, seen.normals[:, 2])


def _rim_height(polar: _Polar) -> float:
    steep = np.abs(polar.upward) < 0.95
    heights = polar.height[steep] if steep.sum() > CONFIG.fewest else polar.height
    return max(float(np.percentile(heights, 98)), CONFIG.lowest)


def _radius_by_height(polar: _Polar, heights: Array, mine: Mask) -> Array:
    """(S,) median radius of the points within each slice; NaN where there are too few."""
    reach = 0.75 * heights[1]
    found = np.full(len(heights), np.nan)
    for number, height in enumerate(heights):
        radii = polar.radius[mine & (np.abs(polar.height - height) < reach)]
        if len(radii) >= CONFIG.fewest_points:
            found[number] = np.median(radii)
    return found


def _is_inside_visible(polar: _Polar, top: float, inner: Array, outer: Array) -> bool:
    """Whether an inside is seen: walls that look inwards well below the rim, and no lid."""
    widest = np.nanmax(np.concatenate([inner[-6:], outer[-6:], [0.0]]))
    walls = np.isfinite(inner[CONFIG.slices // 2 :]).sum() >= CONFIG.inner_slices
    middle = polar.height[polar.radius < 0.5 * widest]
    lid = np.count_nonzero(middle > top - CONFIG.deep)
    return bool(walls and lid < max(0.5 * len(middle), CONFIG.floor_share * len(polar.height)))


def _outer_radii_of_hollow_solid(outer: Array, inner: Array, heights: Array) -> Array:
    """(S,) the outer radius of a hollow thing. A mug shows its outside, a bowl its inside: there it is a wall farther
    out, however far out stray pixels of the near wall lie."""
    if np.isfinite(outer).sum() >= np.isfinite(inner).sum():
        return outer
    with np.errstate(invalid="ignore"):
        thick = outer - inner
        sound = (thick > 0) & (thick < CONFIG.thickest)
    wall = float(np.clip(np.median(thick[sound]), *CONFIG.wall)) if sound.any() else CONFIG.usual_wall
    radii = np.where(sound, outer, inner + wall)
    known = np.isfinite(radii)
    return np.interp(heights, heights[known], radii[known])


def _wall_radii_by_height(polar: _Polar, heights: Array, radii: Array, inner: Array) -> Array:
    """(N, 3) inner radius, outer radius and height from the floor to the rim."""
    with np.errstate(invalid="ignore"):
        thick = radii - inner
        seen = (thick > 0) & (thick < CONFIG.thickest)
    wall = float(np.clip(np.median(thick[seen]), *CONFIG.wall)) if seen.any() else CONFIG.usual_wall
    inside = np.where(seen, inner, radii - wall)
    inside = np.minimum(_smooth_profile_values(inside), radii - CONFIG.wall[0])
    middle = (polar.radius < 0.4 * radii[-1]) & (polar.upward > CONFIG.level)
    floor = float(np.median(polar.height[middle])) if middle.mean() > CONFIG.floor_share else wall
    floor = float(np.clip(floor, CONFIG.wall[0], heights[-1] - CONFIG.deep))
    levels = np.concatenate([[floor], heights[heights > floor + 0.25 * heights[1]]])
    inside = np.maximum(np.interp(levels, heights, inside), CONFIG.wall[0])
    return np.stack([inside, np.interp(levels, heights, radii), levels], axis=1)


def _find_profile_of_top(polar: _Polar, edge: Array) -> Array:
    """(K, 2) the top, from its edge to the middle."""
    rings: list[tuple[float, float]] = []
    for radius in np.linspace(0.9, 0.1, 5) * edge[0]:
        near = polar.height[np.abs(polar.radius - radius) < 0.12 * edge[0]]
        near = near[near > edge[1] - CONFIG.deep]
        if len(near) >= CONFIG.fewest_points:
            rings.append((float(radius), float(np.median(near))))
    return np.array([*rings, (0.0, rings[-1][1] if rings else float(edge[1]))])


def _smooth_profile_values(values: Array) -> Array:
    return np.convolve(np.pad(values, 1, mode="edge"), [0.25, 0.5, 0.25], "valid")


def _simplify_profile(profile: Array) -> Array:
    """The profile without points that hardly bend it, but with some along each long side, and near its corners, where
    else the texture would be smeared from one side of the corner to the other."""
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
