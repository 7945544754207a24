"""Clip the estimated volumes of objects of unknown shape by their neighbours.

Where nothing was measured, a box is a guess, and gives way to other objects.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from grs_agents.base.geometry.transforms import rotation_about_z, to_vec3
from grs_agents.perception.image_geometry import THINNEST
from grs_agents.perception.types import Array, Mask, Solid, UprightBox

SLACK = 0.003  # overlaps up to this (m) are left to physics: boxes are measured no better
STRAY = 0.03  # share of the intruding points that may stay inside: a rim, a handle
LOST = 0.7  # a cut removes at most this share of an object's own points
KEPT = 0.8  # and leaves at least this share of the extent over which they were measured
LONGEST_LOSS = 0.035
"""And removes at most this length of it, m: half of it shifts the centre, whose tolerance is 2 cm."""
SHIFT = 0.015
"""Shallower intrusions (m) are resolved by moving the object; a cut beyond the bounds above would be worse."""
VOLUME = 0.2  # cost of removing the whole box, as a share of the object's own points
CELL = 0.008  # spacing of the grid that stands for a box, m, and the thickness of hollow walls
MOST = 14  # grid points along an edge at most
ROUNDS = 3
FLOOR, STEP = 0.7, 0.002
"""Known objects that fill more than this share of a layer of the box support it; the layers have this spacing, m."""


@dataclass(frozen=True)
class EstimatedVolume:
    """The estimated volume of an object of unknown shape: a box or cylinder, of a hollow object its walls and floor."""

    box: UprightBox
    shape: Solid
    points: Array  # (N, 3) measured, m, robot frame
    hollow: bool = False

    def lift_bottom_above_occupied(self, occupied: Callable[[Array], Mask]) -> "EstimatedVolume":
        """Raise the bottom of the box above its support.

        Args:
            occupied: mask (M,) of the points (M, 3), m, robot frame, inside known objects.
        """
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
        """The measured part of the box ``before`` it was clipped, joined with the clipped box."""
        low, high = self._corners_in_frame(before)
        first, last = np.percentile(_transform_to_box_frame(before, self.points), (1, 99), axis=0)
        half = np.array(before.size) / 2
        return _box_from_corners(
            before, np.minimum(low, np.maximum(first, -half)), np.maximum(high, np.minimum(last, half))
        )

    def _corners_in_frame(self, frame: UprightBox) -> tuple[Array, Array]:
        """Lowest and highest corner (3,) in the frame of a box of the same yaw."""
        middle = _transform_to_box_frame(frame, np.array([self.box.center]))[0]
        return middle - np.array(self.box.size) / 2, middle + np.array(self.box.size) / 2

    @property
    def grid_points(self) -> Array:
        """Grid points (M, 3) in the volume, m, robot frame."""
        counts = [int(np.clip(np.ceil(side / CELL) + 1, 2, MOST)) for side in self.box.size]
        axes = [np.linspace(-1, 1, count) for count in counts]
        grid = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
        if self.shape == "cylinder":
            grid = grid[np.hypot(grid[:, 0], grid[:, 1]) <= 1]
        local = grid * np.array(self.box.size) / 2
        if self.hollow:
            local = local[self.walls_mask(local)]
        return local @ rotation_about_z(self.box.yaw).T + self.box.center

    def walls_mask(self, local: Array) -> Mask:
        """Mask (M,) of the points (M, 3) of the box, in its frame, that lie in the walls or the floor if hollow."""
        x, y, z = (extent / 2 for extent in self.box.size)
        is_round = self.shape == "cylinder"
        beside = np.hypot(local[:, 0], local[:, 1]) - x if is_round else (np.abs(local[:, :2]) - (x, y)).max(axis=1)
        return np.asarray((local[:, 2] < CELL - z) | (beside > -CELL), np.bool_)


@dataclass(frozen=True)
class _Cut:
    """A side of a box moved inwards."""

    axis: int
    side: int  # -1 or 1
    place: float  # new coordinate of the side along the axis, m
    cost: float


def clip_boxes(claims: Sequence[EstimatedVolume], occupied: Array) -> list[EstimatedVolume]:
    """Move the sides of boxes inwards until they exclude ``occupied`` points (M, 3) and each other.

    Of two overlapping boxes the one with the cheaper cut is cut; a box without an admissible cut stays as it is. A
    cylinder that is cut at its side becomes a box.
    """
    clipped = list(claims)
    for _ in range(ROUNDS):
        before = list(clipped)
        clipped = [_shrink_volume_by_cut(each, _find_cheapest_cut(each, occupied, certain=True)) for each in clipped]
        for i, j in combinations(range(len(clipped)), 2):
            first, second = clipped[i], clipped[j]
            cuts = _find_cheapest_cut(first, second.grid_points), _find_cheapest_cut(second, first.grid_points)
            costs = [np.inf if cut is None else cut.cost for cut in cuts]
            if costs[0] <= costs[1]:
                clipped[i] = _shrink_volume_by_cut(first, cuts[0])
            else:
                clipped[j] = _shrink_volume_by_cut(second, cuts[1])
        if clipped == before:
            break
    return clipped


def _transform_to_box_frame(box: UprightBox, points: Array) -> Array:
    """Points about the centre of a box and along its axes."""
    return (points - box.center) @ rotation_about_z(box.yaw)


def _box_from_corners(frame: UprightBox, low: Array, high: Array) -> UprightBox:
    """The box between two corners (3,) in the frame of another box."""
    center = rotation_about_z(frame.yaw) @ ((low + high) / 2) + frame.center
    return UprightBox(center=to_vec3(center), size=to_vec3(high - low), yaw=frame.yaw)


def _find_cheapest_cut(claim: EstimatedVolume, others: Array, certain: bool = False) -> _Cut | None:
    """The cheapest cut that excludes the ``others`` (M, 3); ``None`` if none are inside or no cut is admissible.

    If the others are ``certain``, the points measured beyond a cut are theirs, so the bounds on the lost extent do not
    apply. A neighbouring box may be wrong itself.
    """
    near = others[np.linalg.norm(others - claim.box.center, axis=1) < np.linalg.norm(claim.box.size) / 2]
    local = _transform_to_box_frame(claim.box, near)
    reach = np.maximum(np.array(claim.box.size) / 2 - SLACK, 0)
    inside = (np.abs(local) < reach).all(axis=1)
    if claim.shape == "cylinder":
        inside &= np.hypot(local[:, 0], local[:, 1]) < reach[0]
    if claim.hollow:
        inside &= claim.walls_mask(local)
    local = local[inside]
    if not len(local):
        return None
    points, half = _transform_to_box_frame(claim.box, claim.points), np.array(claim.box.size) / 2
    low, high = np.percentile(local, (100 * STRAY, 100 - 100 * STRAY), axis=0)
    shallow = float(np.minimum(half - low, half + high).min()) < SHIFT
    best: _Cut | None = None
    for axis in range(3):
        for side in (-1, 1):
            place = side * float(np.percentile(side * local[:, axis], 100 * STRAY))
            left = side * place + half[axis]
            if left < THINNEST:
                continue
            if shallow or not certain:
                first, last = np.percentile(side * points[:, axis], (1, 99))
                lost_length = max(last - side * place, 0.0) + max(-half[axis] - first, 0.0)
                if lost_length > min(SLACK + (1 - KEPT) * (last - first), LONGEST_LOSS):
                    continue
            lost = float((side * points[:, axis] > side * place).mean())
            cost = lost + VOLUME * (1 - left / (2 * half[axis]))
            if lost < LOST and (best is None or cost < best.cost):
                best = _Cut(axis, side, place, cost)
    return best


def _shrink_volume_by_cut(claim: EstimatedVolume, cut: _Cut | None) -> EstimatedVolume:
    if cut is None:
        return claim
    low, high = -np.array(claim.box.size) / 2, np.array(claim.box.size) / 2
    (high if cut.side > 0 else low)[cut.axis] = cut.place
    return replace(claim, box=_box_from_corners(claim.box, low, high), shape="box" if cut.axis < 2 else claim.shape)
