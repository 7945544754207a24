"""How well an asset's colours at a pose agree with the photo, whatever the light."""

from dataclasses import dataclass

import numpy as np

from grs_agents.perception.matching.asset_appearance import Appearance, Floats
from grs_agents.perception.matching.observation import Observation
from grs_agents.perception.matching.pose_alignment import AlignedPoses
from grs_agents.perception.types import Array

_FEWEST = 8
_SPREAD = (0.30, 0.14, 0.14)  # logarithms by which brightness and the two ratios may differ
_HUES = np.array(_SPREAD[1:], np.float32)
_WORSE = 0.0025  # a pose that fits worse by more than this (m) is not looked at
_COARSE = 120  # so many pixels tell which turn is best
_RIDGE = np.diag([0.002, 0.03, 0.03, 0.03]).astype(np.float32)
_MOST = np.float32(4.0)  # a misfit of one pixel counts as this at most, so that a highlight does not decide
_LEAST = 0.05  # no mean misfit is taken for less


@dataclass(frozen=True)
class Light:
    """What the light of a scene does to colours."""

    gain: float  # by how much it makes them brighter, logarithm
    tint: Array  # (2,) by how much it shifts both ratios, logarithms
    slack: float  # how much more or less of a tint one object may have


DAYLIGHT = Light(-0.35, np.zeros(2), 0.25)  # what is taken for the light of a scene of which nothing is known


@dataclass(frozen=True)
class ColorAgreement:
    """The best agreement over poses and over the turns that leave the shape as it is."""

    level: Floats  # (P,) misfit in brightness of each pixel, beyond what shading explains, in units of what it may be
    hue: Floats  # (P, 2) by how much both ratios differ, logarithms
    gain: float  # by how much brighter (logarithm) the photo is than the asset
    # by how much the asset's pattern explains the photo better than one colour would: half the logarithm of the ratio
    # of both misfits
    pattern: float
    rank: int  # which of the poses it came from

    @property
    def mean_hue_shift(self) -> Floats:
        """(2,) by how much the light would have to be coloured: logarithms of both ratios."""
        return self.hue.mean(axis=0)

    def matching_pixel_fraction(self, light: Light) -> float:
        """Share of the pixels whose colour is the asset's in a light, 0..1, soft."""
        return float(np.exp(-0.5 * _color_misfit_per_pixel(self.level, self.hue, light)).mean())


def compare_colors(
    asset: Appearance, poses: AlignedPoses, seen: Observation, light: Light = DAYLIGHT
) -> ColorAgreement | None:
    """Compare colours at the poses that fit about equally well; ``None`` where there are too few pixels."""
    if len(seen.surface) < _FEWEST:
        return None
    ranks = np.flatnonzero(poses.pose_costs <= poses.pose_costs[0] + _WORSE)[:2]
    best: tuple[float, int, Floats] | None = None
    for rank in ranks.tolist():
        rotations = poses.rotations[rank] @ asset.symmetries
        level, hue, _ = _color_differences(asset, poses, rank, rotations, seen, _COARSE)
        agreement = np.exp(-0.5 * _color_misfit_per_pixel(level, hue, light)).mean(axis=1)
        one = int(np.argmax(agreement))
        if best is None or agreement[one] > best[0]:
            best = float(agreement[one]), rank, rotations[one]
    assert best is not None
    _, rank, turn = best
    level, hue, gain = _color_differences(asset, poses, rank, turn[None], seen, len(seen.surface))
    return ColorAgreement(
        level[0], hue[0], float(gain[0]), _score_pattern_over_plain(asset, poses, rank, seen, (level[0], hue[0])), rank
    )


def _color_differences(
    asset: Appearance, poses: AlignedPoses, rank: int, rotations: Floats, seen: Observation, count: int
) -> tuple[Floats, Floats, Floats]:
    """Brightness (S, P) beyond shading, hues (S, P, 2) and gain (S,) by which the photo differs, for each turn."""
    nearest = asset.nearest_point_indices((seen.surface[:count] - poses.centers[rank]) @ rotations)
    apart = seen.log_colors[:count] - asset.log_colors[nearest]
    # turns that leave the shape as it is leave its normals too, so that the shading is one for all of them
    level = apart[..., 0] @ _shading_removal_matrix(asset.normals[nearest[0]] @ rotations[0].T)
    return level / np.float32(_SPREAD[0]), apart[..., 1:], apart[..., 0].mean(axis=1)


def _shading_removal_matrix(normals: Floats) -> Floats:
    """(P, P) takes out of brightness at surfaces with these normals (P, 3) what one lamp and an even light explain."""
    shading = np.concatenate([np.ones((len(normals), 1), np.float32), normals], axis=1)
    part = shading / np.float32(len(normals))
    return np.eye(len(normals), dtype=np.float32) - part @ np.linalg.solve(shading.T @ part + _RIDGE, shading.T)


def _color_misfit_per_pixel(level: Floats, hue: Floats, light: Light) -> Floats:
    """(..., P) of brightness and hue together."""
    tint = np.clip(hue.mean(axis=-2, keepdims=True), light.tint - light.slack, light.tint + light.slack)
    return level**2 + (((hue - tint.astype(np.float32)) / _HUES) ** 2).sum(axis=-1)


def _score_pattern_over_plain(
    asset: Appearance, poses: AlignedPoses, rank: int, seen: Observation, differences: tuple[Floats, Floats]
) -> float:
    """How much better the asset's pattern explains the photo than one colour; ``differences``: what both leave."""
    level, hue = differences
    nearest = asset.nearest_point_indices((seen.surface - poses.centers[rank]) @ poses.rotations[rank])
    plain = (
        seen.log_colors[:, 0]
        @ _shading_removal_matrix(asset.normals[nearest] @ poses.rotations[rank].T)
        / np.float32(_SPREAD[0])
    )
    without = plain**2 + (((seen.log_colors[:, 1:] - seen.log_colors[:, 1:].mean(axis=0)) / _HUES) ** 2).sum(axis=1)
    given = level**2 + (((hue - hue.mean(axis=0)) / _HUES) ** 2).sum(axis=1)
    one, other = (float(np.minimum(misfit, _MOST).mean()) + _LEAST for misfit in (without, given))
    return 0.5 * float(np.log(one / other))
