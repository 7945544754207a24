"""Boxes of what is not known are guesses where nothing was measured: there they give way to what stands beside them."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from grs_agents.scene.frame import Array, Mask
from grs_agents.scene.geometry import THINNEST
from grs_agents.scene.turning import about_z
from grs_agents.scene.types import Solid, UprightBox

SLACK = 0.003
"""Overlaps up to this (m) are left to physics: boxes are measured no better."""
STRAY = 0.03
"""Of what intrudes this share may stay: a rim, a handle."""
LOST = 0.7
"""A cut may cut off at most this share of a thing's own points."""
VOLUME = 0.2
"""A cut that takes all of a box off counts as much as one that takes this share of its points off."""
CELL = 0.008
"""A box is taken for points on a grid of at most so many m."""
MOST = 14
"""At most so many of them along an edge."""
ROUNDS = 3


@dataclass(frozen=True)
class Claim:
    """The space that a thing of unknown shape is thought to fill, and its measured (N, 3) points, m, robot frame."""

    box: UprightBox
    shape: Solid
    points: Array

    @property
    def space(self) -> Array:
        """(M, 3) points all over it, m, robot frame."""
        counts = [int(np.clip(np.ceil(side / CELL) + 1, 2, MOST)) for side in self.box.size]
        axes = [np.linspace(-1, 1, count) for count in counts]
        grid = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
        if self.shape == "cylinder":
            grid = grid[np.hypot(grid[:, 0], grid[:, 1]) <= 1]
        return grid * np.array(self.box.size) / 2 @ about_z(self.box.yaw).T + self.box.center


@dataclass(frozen=True)
class _Cut:
    """A side of a box moved inwards: its axis, which side of it, the new place of that side, and what that costs."""

    axis: int
    side: int
    place: float
    cost: float


def clipped(claims: Sequence[Claim], firm: Array) -> list[Claim]:
    """Move the sides of boxes inwards until they leave out (M, 3) points of what stands ``firm``, and each other.

    Of two boxes the one gives way that loses fewer of its own points; one that would lose too many stays as it is.
    A cylinder that is cut at its side becomes a box.
    """
    found = list(claims)
    for _ in range(ROUNDS):
        before = list(found)
        found = [_applied(one, _cut(one, firm)) for one in found]
        for first, second in combinations(range(len(found)), 2):
            one, other = found[first], found[second]
            cuts = _cut(one, other.space), _cut(other, one.space)
            if min(cuts, key=_cost) is cuts[0]:
                found[first] = _applied(one, cuts[0])
            else:
                found[second] = _applied(other, cuts[1])
        if found == before:
            break
    return found


def _cost(cut: _Cut | None) -> float:
    return np.inf if cut is None else cut.cost


def _local(claim: Claim, points: Array) -> Array:
    return (points - claim.box.center) @ about_z(claim.box.yaw)


def _inside(claim: Claim, local: Array) -> Mask:
    half = np.maximum(np.array(claim.box.size) / 2 - SLACK, 0)
    inside = (np.abs(local) < half).all(axis=1)
    if claim.shape == "cylinder":
        inside &= np.hypot(local[:, 0], local[:, 1]) < half[0]
    return np.asarray(inside, np.bool_)


def _cut(claim: Claim, others: Array) -> _Cut | None:
    """The cheapest cut that leaves the ``others`` (M, 3) out; ``None`` if none are inside or every cut is too dear."""
    near = others[np.linalg.norm(others - claim.box.center, axis=1) < np.linalg.norm(claim.box.size) / 2]
    local = _local(claim, near)
    local = local[_inside(claim, local)]
    if not len(local):
        return None
    own, half = _local(claim, claim.points), np.array(claim.box.size) / 2
    cuts: list[_Cut] = []
    for axis in range(3):
        for side in (-1, 1):
            place = side * float(np.percentile(side * local[:, axis], 100 * STRAY))
            left = side * place + half[axis]
            if left < THINNEST:
                continue
            lost = float((side * own[:, axis] > side * place).mean())
            if lost < LOST:
                cuts.append(_Cut(axis, side, place, lost + VOLUME * (1 - left / (2 * half[axis]))))
    return min(cuts, key=_cost, default=None)


def _applied(claim: Claim, cut: _Cut | None) -> Claim:
    if cut is None:
        return claim
    low, high = -np.array(claim.box.size) / 2, np.array(claim.box.size) / 2
    (high if cut.side > 0 else low)[cut.axis] = cut.place
    x, y, z = (float(value) for value in about_z(claim.box.yaw) @ ((low + high) / 2) + claim.box.center)
    length, width, height = (float(value) for value in high - low)
    box = UprightBox(center=(x, y, z), size=(length, width, height), yaw=claim.box.yaw)
    return replace(claim, box=box, shape="box" if cut.axis < 2 else claim.shape)
