"""Boxes of what is not known are guesses where nothing was measured: there they give way to what stands beside them."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from grs_agents.base import Vec3
from grs_agents.base.geometry.transforms import rotation_about_z, to_vec3
from grs_agents.perception.image_geometry import THINNEST
from grs_agents.perception.types import Array, Mask, Solid, UprightBox

SLACK = 0.003  # overlaps up to this (m) are left to physics: boxes are measured no better
STRAY = 0.03  # of what intrudes this share may stay: a rim, a handle
LOST = 0.7  # a cut may cut off at most this share of an object's own points
KEPT = 0.8  # and must leave at least this share of the extent over which they were measured: less has not its size
LONGEST_LOSS = 0.035
"""And may leave out at most this length of it, m: half of it shifts the centre, which is to stay within 2 cm."""
SHIFT = 0.015
"""What reaches in no farther than this (m) can be moved out; a cut that loses more than those bounds is worse."""
VOLUME = 0.2  # a cut that takes all of a box off counts as much as one that takes this share of its points off
CELL = 0.008  # a box is taken for points on a grid of at most so many m
MOST = 14  # at most so many of them along an edge
ROUNDS = 3
FLOOR, STEP = 0.7, 0.002
"""Known objects that fill more than this share of the lowest part of a box carry it; looked at in such steps, m."""


@dataclass(frozen=True)
class EstimatedVolume:
    """The space that an object of unknown shape is thought to fill; a hollow one fills its walls and floor alone."""

    box: UprightBox
    shape: Solid
    points: Array  # (N, 3) measured, m, robot frame
    hollow: bool = False

    def lift_bottom_above_occupied(self, occupied: Callable[[Array], Mask]) -> "EstimatedVolume":
        """It on what known objects fill of the lowest part of its box: ``occupied`` says which points they do."""
        if self.hollow or not len(self.points):
            return self
        space, bottom = self.grid_points, self.box.center[2] - self.box.size[2] / 2
        foot = space[space[:, 2] < bottom + STEP] * (1, 1, 0)
        lowest = min(float(np.percentile(self.points[:, 2], 2)), bottom + self.box.size[2] / 2)
        levels = [np.array([0, 0, level]) for level in np.arange(bottom, lowest, STEP)]
        filled = [float(level[2]) for level in levels if occupied(foot + level).mean() > FLOOR]
        if not filled:
            return self
        low, high = self._corners_in_frame(self.box)
        low[2] += filled[-1] + STEP - bottom
        return replace(self, box=_box_from_corners(self.box, low, high))

    def measured_box(self, before: UprightBox) -> UprightBox:
        """The box of what was measured: ``before`` it gave way, without what was only guessed of that."""
        low, high = self._corners_in_frame(before)
        first, last = np.percentile(_transform_to_box_frame(before, self.points), (1, 99), axis=0)
        half = np.array(before.size) / 2
        return _box_from_corners(
            before, np.minimum(low, np.maximum(first, -half)), np.maximum(high, np.minimum(last, half))
        )

    def _corners_in_frame(self, frame: UprightBox) -> tuple[Array, Array]:
        """Its lowest and highest corner about the centre and along the axes of a box of the same yaw."""
        middle = _transform_to_box_frame(frame, np.array([self.box.center]))[0]
        return middle - np.array(self.box.size) / 2, middle + np.array(self.box.size) / 2

    @property
    def grid_points(self) -> Array:
        """(M, 3) points all over it, m, robot frame."""
        counts = [int(np.clip(np.ceil(side / CELL) + 1, 2, MOST)) for side in self.box.size]
        axes = [np.linspace(-1, 1, count) for count in counts]
        grid = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
        if self.shape == "cylinder":
            grid = grid[np.hypot(grid[:, 0], grid[:, 1]) <= 1]
        local = grid * np.array(self.box.size) / 2
        if self.hollow:
            local = local[_inside_walls_mask(local, self.box.size, self.shape == "cylinder")]
        return local @ rotation_about_z(self.box.yaw).T + self.box.center


@dataclass(frozen=True)
class _Cut:
    """A side of a box moved inwards: its axis, which side of it, the new place of that side, and what that costs."""

    axis: int
    side: int
    place: float
    cost: float


def clip_boxes(claims: Sequence[EstimatedVolume], occupied: Array) -> list[EstimatedVolume]:
    """Move the sides of boxes inwards until they leave out (M, 3) points of what stands ``occupied``, and each other.
    Of two boxes the one gives way that loses fewer of its own points; one that would lose too many stays as it is. A
    cylinder that is cut at its side becomes a box."""
    found = list(claims)
    for _ in range(ROUNDS):
        before = list(found)
        found = [_shrink_volume_by_cut(one, _find_cheapest_cut(one, occupied, certain=True)) for one in found]
        for first, second in combinations(range(len(found)), 2):
            one, other = found[first], found[second]
            cuts = _find_cheapest_cut(one, other.grid_points), _find_cheapest_cut(other, one.grid_points)
            if min(cuts, key=_cut_cost_or_infinity) is cuts[0]:
                found[first] = _shrink_volume_by_cut(one, cuts[0])
            else:
                found[second] = _shrink_volume_by_cut(other, cuts[1])
        if found == before:
            break
    return found


def _cut_cost_or_infinity(cut: _Cut | None) -> float:
    return np.inf if cut is None else cut.cost


def _transform_to_box_frame(box: UprightBox, points: Array) -> Array:
    """Points about the centre of a box and along its axes."""
    return (points - box.center) @ rotation_about_z(box.yaw)


def _box_from_corners(frame: UprightBox, low: Array, high: Array) -> UprightBox:
    """The box between two corners about the centre and along the axes of another."""
    center = rotation_about_z(frame.yaw) @ ((low + high) / 2) + frame.center
    return UprightBox(center=to_vec3(center), size=to_vec3(high - low), yaw=frame.yaw)


def _inside_volume_mask(claim: EstimatedVolume, local: Array) -> Mask:
    half = np.maximum(np.array(claim.box.size) / 2 - SLACK, 0)
    inside = (np.abs(local) < half).all(axis=1)
    if claim.shape == "cylinder":
        inside &= np.hypot(local[:, 0], local[:, 1]) < half[0]
    if claim.hollow:
        inside &= _inside_walls_mask(local, claim.box.size, claim.shape == "cylinder")
    return np.asarray(inside, np.bool_)


def _find_cheapest_cut(claim: EstimatedVolume, others: Array, certain: bool = False) -> _Cut | None:
    """The cheapest cut that leaves the ``others`` (M, 3) out; ``None`` if none are inside or every cut is too dear.

    Where it is ``certain`` that others are there, what was measured beyond them is theirs; a box may be wrong itself.
    """
    near = others[np.linalg.norm(others - claim.box.center, axis=1) < np.linalg.norm(claim.box.size) / 2]
    local = _transform_to_box_frame(claim.box, near)
    local = local[_inside_volume_mask(claim, local)]
    if not len(local):
        return None
    own, half = _transform_to_box_frame(claim.box, claim.points), np.array(claim.box.size) / 2
    cuts: list[_Cut] = []
    low, high = np.percentile(local, (100 * STRAY, 100 - 100 * STRAY), axis=0)
    shallow = float(np.minimum(half - low, half + high).min()) < SHIFT
    for axis in range(3):
        for side in (-1, 1):
            place = side * float(np.percentile(side * local[:, axis], 100 * STRAY))
            left = side * place + half[axis]
            if left < THINNEST or not (
                (certain and not shallow) or _is_extent_mostly_kept(axis, side * place, side, own, half)
            ):
                continue
            lost = float((side * own[:, axis] > side * place).mean())
            if lost < LOST:
                cuts.append(_Cut(axis, side, place, lost + VOLUME * (1 - left / (2 * half[axis]))))
    return min(cuts, key=_cut_cost_or_infinity, default=None)


def _is_extent_mostly_kept(axis: int, place: float, side: int, own: Array, half: Array) -> bool:
    """Whether a cut at ``place`` (m, along ``side`` times the axis) keeps most of the extent of ``own`` points."""
    low, high = np.percentile(side * own[:, axis], (1, 99))
    lost = max(high - place, 0.0) + max(-half[axis] - low, 0.0)
    return bool(lost <= min(SLACK + (1 - KEPT) * (high - low), LONGEST_LOSS))


def _shrink_volume_by_cut(claim: EstimatedVolume, cut: _Cut | None) -> EstimatedVolume:
    if cut is None:
        return claim
    low, high = -np.array(claim.box.size) / 2, np.array(claim.box.size) / 2
    (high if cut.side > 0 else low)[cut.axis] = cut.place
    return replace(claim, box=_box_from_corners(claim.box, low, high), shape="box" if cut.axis < 2 else claim.shape)


def _inside_walls_mask(points: Array, size: Vec3, around: bool) -> Mask:
    """Which of points (N, 3) in the box of a hollow box or cylinder, about its centre, are in its walls or floor."""
    x, y, z = (extent / 2 for extent in size)
    beside = np.hypot(points[:, 0], points[:, 1]) - x if around else (np.abs(points[:, :2]) - (x, y)).max(axis=1)
    return np.asarray((points[:, 2] < CELL - z) | (beside > -CELL), np.bool_)
