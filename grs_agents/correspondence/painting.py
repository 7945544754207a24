"""How well an asset's colours at a pose agree with the photo, whatever the light."""

from dataclasses import dataclass

import numpy as np

from grs_agents.correspondence.appearance import Appearance
from grs_agents.correspondence.laying import Laid, project
from grs_agents.correspondence.observation import Observation, View
from grs_agents.scene.frame import Array

_NEAR = 0.015
"""A point of the surface is seen where what was measured is at most so far off, m."""
_FEWEST = 8
_SPREAD = (0.30, 0.14, 0.14)
"""Logarithms by which brightness and the two ratios may differ."""
_AROUND = 20
"""What is round is turned so often."""
_SLANT = 0.15
_WORSE = 0.0025
"""A pose that fits worse by more than this (m) is not looked at."""
_COARSE, _FINE = 350, 1500
"""So many points tell which pose is best, and how good it is."""


@dataclass(frozen=True)
class Light:
    """What the light of a scene does to colours.

    Attributes:
        gain: by how much it makes them brighter, logarithm.
        tint: (2,) by how much it shifts both ratios, logarithms.
        slack: how much more or less of a tint one object may have.
    """

    gain: float
    tint: Array
    slack: float


DAYLIGHT = Light(-0.35, np.zeros(2), 0.25)
"""What is taken for the light of a scene of which nothing is known."""


@dataclass(frozen=True)
class Painted:
    """The best agreement over poses.

    Attributes:
        agreement: share of the surface seen whose colour is the photo's, 0..1, soft.
        tint: by how much the light would have to be coloured: logarithms of both ratios.
        gain: by how much brighter (logarithm) the photo is than the asset.
        seen: share of the facing surface that lies on the candidate's pixels.
        pose: (4, 4) the pose it is for.
        rank: which of the laid poses it came from.
    """

    agreement: float
    tint: tuple[float, float]
    gain: float
    seen: float
    pose: Array
    rank: int


def paint(asset: Appearance, laid: Laid, seen: Observation, view: View) -> Painted | None:
    """Compare colours at each of the poses; ``None`` where too little of the surface is seen."""
    misfit = laid.off + 0.7 * laid.air
    ranks = np.flatnonzero(misfit <= misfit[0] + _WORSE)
    around = _around(asset.round)
    poses = (laid.poses[ranks][:, None] @ around[None]).reshape(-1, 4, 4)
    coarse, *_ = _agreement(asset, poses, _COARSE, seen, view, DAYLIGHT)
    best = int(np.argmax(coarse))
    return _told(asset, poses[best], seen, view, DAYLIGHT, int(ranks[best // len(around)]))


def repaint(asset: Appearance, painted: Painted, seen: Observation, view: View, light: Light) -> Painted | None:
    """The same pose, once the light of the scene is known."""
    return _told(asset, painted.pose, seen, view, light, painted.rank)


def _told(
    asset: Appearance, pose: Array, seen: Observation, view: View, light: Light, rank: int
) -> Painted | None:  # fmt: skip
    agreement, tint, gain, share = _agreement(asset, pose[None], _FINE, seen, view, light)
    if agreement[0] <= 0:
        return None
    red, blue = (float(value) for value in tint[0])
    return Painted(float(agreement[0]), (red, blue), float(gain[0]), float(share[0]), pose, rank)


def _around(axis: int) -> Array:
    """(T, 4, 4) turns about the axis of what is round; of anything else the identity."""
    if axis < 0:
        return np.eye(4)[None]
    one, two = (axis + 1) % 3, (axis + 2) % 3
    angles = np.arange(_AROUND) * 2 * np.pi / _AROUND
    found = np.tile(np.eye(4), (_AROUND, 1, 1))
    found[:, one, one] = found[:, two, two] = np.cos(angles)
    found[:, one, two], found[:, two, one] = -np.sin(angles), np.sin(angles)
    return found


def _agreement(
    asset: Appearance, poses: Array, count: int, seen: Observation, view: View, light: Light
) -> tuple[Array, Array, Array, Array]:
    """Agreement, tint, gain and share seen at each pose (K, 4, 4); all 0 where too little is seen."""
    placed = asset.points[:count] @ poses[:, :3, :3].transpose(0, 2, 1) + poses[:, None, :3, 3]
    normals = asset.normals[:count] @ poses[:, :3, :3].transpose(0, 2, 1)
    ray = placed - view.eye
    facing = np.einsum("kni,kni->kn", normals, ray) < -_SLANT * np.linalg.norm(ray, axis=2)
    rows, columns, depth, inside = project(view, placed)
    measured = view.frame.depth[rows, columns]
    lit = facing & inside & seen.mask[rows, columns] & ((measured <= 0) | (np.abs(measured - depth) < _NEAR))
    number = lit.sum(axis=1)
    weight = lit / np.maximum(number, 1)[:, None]
    apart = view.tones[rows, columns] - asset.tones[:count]
    gain, middle = (weight * apart[..., 0]).sum(axis=1), np.einsum("kn,knc->kc", weight, apart[..., 1:])
    shading = np.concatenate([np.ones((*lit.shape, 1)), normals], axis=2)
    left: Array = np.einsum("kn,kni,knj->kij", weight, shading, shading) + np.diag([0.002, 0.03, 0.03, 0.03])
    right: Array = np.einsum("kn,kni,kn->ki", weight, shading, apart[..., 0])
    level = apart[..., 0] - np.einsum("kni,ki->kn", shading, np.linalg.solve(left, right[..., None])[..., 0])
    hue = apart[..., 1:] - np.clip(middle, light.tint - light.slack, light.tint + light.slack)[:, None]
    misfit = (level / _SPREAD[0]) ** 2 + ((hue / _SPREAD[1:]) ** 2).sum(axis=2)
    agreement = (weight * np.exp(-0.5 * misfit)).sum(axis=1) * (number >= _FEWEST)
    return agreement, middle, gain, number / np.maximum(facing.sum(axis=1), 1)
