"""Agreement of an asset's colours at a pose with the photo, invariant to the light."""

from dataclasses import dataclass

import numpy as np

from grs_agents.perception.matching.asset_appearance import Appearance, Floats
from grs_agents.perception.matching.pose_alignment import AlignedPoses
from grs_agents.perception.matching.segment_features import SegmentFeatures
from grs_agents.perception.types import Array

_FEWEST = 8  # pixels of a comparison
_SPREAD = (0.30, 0.14, 0.14)  # standard deviations of log brightness and of the two log ratios
_HUES = np.array(_SPREAD[1:], np.float32)
_WORSE = 0.0025  # poses of a cost higher by more than this (m) are skipped
_COARSE = 120  # number of pixels that decide among the symmetric turns
_RIDGE = np.diag([0.002, 0.03, 0.03, 0.03]).astype(np.float32)
_MOST = np.float32(4.0)  # bound on the misfit of a pixel, so that a highlight does not decide
_LEAST = 0.05  # added to each mean misfit


@dataclass(frozen=True)
class Light:
    """Effect of a scene's light on colours."""

    gain: float  # log factor of brightness
    tint: Array  # (2,) shift of both log ratios
    slack: float  # tolerance of the tint of an object


DAYLIGHT = Light(-0.35, np.zeros(2), 0.25)  # the prior for a scene of unknown light


@dataclass(frozen=True)
class ColorAgreement:
    """The best agreement over poses and symmetric turns."""

    level: Floats  # (P,) brightness residual of each pixel after shading, in standard deviations
    hue: Floats  # (P, 2) differences of both log ratios
    gain: float  # log brightness of the photo relative to the asset
    pattern: float  # half the log ratio of the misfit of a plain colour to that of the asset's pattern
    rank: int  # index of the pose

    @property
    def mean_hue_shift(self) -> Floats:
        """Tint (2,) of a light that would explain the hues: means of both log ratios."""
        return self.hue.mean(axis=0)

    def matching_pixel_fraction(self, light: Light) -> float:
        """Soft share, 0..1, of the pixels that have the asset's colour in a light."""
        return float(np.exp(-0.5 * _color_misfit_per_pixel(self.level, self.hue, light)).mean())


def compare_colors(
    asset: Appearance, poses: AlignedPoses, seen: SegmentFeatures, light: Light = DAYLIGHT
) -> ColorAgreement | None:
    """Compare colours at the poses of about equal cost; ``None`` with too few pixels."""
    if len(seen.surface) < _FEWEST:
        return None
    ranks = np.flatnonzero(poses.pose_costs <= poses.pose_costs[0] + _WORSE)[:2]
    best: tuple[float, int, Floats] | None = None
    for rank in ranks.tolist():
        rotations = poses.rotations[rank] @ asset.symmetries
        level, hue, _ = _color_differences(asset, poses, rank, rotations, seen, _COARSE)
        agreement = np.exp(-0.5 * _color_misfit_per_pixel(level, hue, light)).mean(axis=1)
        number = int(np.argmax(agreement))
        if best is None or agreement[number] > best[0]:
            best = float(agreement[number]), rank, rotations[number]
    assert best is not None
    _, rank, turn = best
    (level,), (hue,), (gain,) = _color_differences(asset, poses, rank, turn[None], seen, len(seen.surface))
    # The pattern: how much better do the asset's colours explain the photo than a plain colour would?
    nearest = asset.nearest_point_indices((seen.surface - poses.centers[rank]) @ poses.rotations[rank])
    shading = _shading_removal_matrix(asset.normals[nearest] @ poses.rotations[rank].T)
    plain_level = seen.log_colors[:, 0] @ shading / np.float32(_SPREAD[0])
    ratios = seen.log_colors[:, 1:]
    plain = plain_level**2 + (((ratios - ratios.mean(axis=0)) / _HUES) ** 2).sum(axis=1)
    patterned = level**2 + (((hue - hue.mean(axis=0)) / _HUES) ** 2).sum(axis=1)
    plain_misfit, misfit = (float(np.minimum(each, _MOST).mean()) + _LEAST for each in (plain, patterned))
    return ColorAgreement(level, hue, float(gain), 0.5 * float(np.log(plain_misfit / misfit)), rank)


def _color_differences(
    asset: Appearance, poses: AlignedPoses, rank: int, rotations: Floats, seen: SegmentFeatures, count: int
) -> tuple[Floats, Floats, Floats]:
    """Differences of the photo for each turn (S): brightness without shading (S, P), hues (S, P, 2), gain (S,)."""
    nearest = asset.nearest_point_indices((seen.surface[:count] - poses.centers[rank]) @ rotations)
    apart = seen.log_colors[:count] - asset.log_colors[nearest]
    # symmetric turns preserve the normals too, so the shading is the same for all
    level = apart[..., 0] @ _shading_removal_matrix(asset.normals[nearest[0]] @ rotations[0].T)
    return level / np.float32(_SPREAD[0]), apart[..., 1:], apart[..., 0].mean(axis=1)


def _shading_removal_matrix(normals: Floats) -> Floats:
    """Matrix (P, P) that projects the shading by a lamp and ambient light out of brightness at these normals (P, 3)."""
    shading = np.concatenate([np.ones((len(normals), 1), np.float32), normals], axis=1)
    part = shading / np.float32(len(normals))
    return np.eye(len(normals), dtype=np.float32) - part @ np.linalg.solve(shading.T @ part + _RIDGE, shading.T)


def _color_misfit_per_pixel(level: Floats, hue: Floats, light: Light) -> Floats:
    """Misfit (..., P) of brightness and hue."""
    tint = np.clip(hue.mean(axis=-2, keepdims=True), light.tint - light.slack, light.tint + light.slack)
    return level**2 + (((hue - tint.astype(np.float32)) / _HUES) ** 2).sum(axis=-1)
