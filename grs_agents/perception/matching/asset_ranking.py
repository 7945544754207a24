"""Rank assets for a candidate by features of their fit: size, place, colours, pattern.

The likelihoods are those of a conditional logit (McFadden 1974) over the tried assets and none of them. Its weights
were fitted to scenes of `evals.synthesis` that no reported figure is measured on.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from grs_agents.perception.matching.asset_appearance import ComparedAssets
from grs_agents.perception.matching.color_agreement import DAYLIGHT, ColorAgreement, Light, compare_colors
from grs_agents.perception.matching.color_histogram import LEVEL_WIDTH, shift_histogram_brightness
from grs_agents.perception.matching.confidence import INPUTS, asset_confidences, confidence_inputs
from grs_agents.perception.matching.pose_alignment import AlignedPoses, align_asset_to_points, compute_alignment_start
from grs_agents.perception.matching.printed_text import score_word_match
from grs_agents.perception.matching.segment_features import SegmentFeatures
from grs_agents.perception.types import Array, RGBDFrame, TableFrame

Use = Literal["all", "no size"]
_WEIGHTS_OF: dict[str, tuple[float, float]] = {
    "free space": (-0.468, 0),
    "large": (-2.253, 0),
    "small": (-1.39, 0),
    "height": (-0.242, 0),
    "residual behind": (-0.517, 0),
    "residual x pixels": (-0.109, 0),
    "colors": (1.561, 1.651),
    "agreement": (-1.583, -1.961),
    "agreement behind": (2.835, 3.448),
    "pattern": (4.955, 5.432),
    "pattern behind": (-2.405, -2.61),
    "tint": (-0.937, -1.361),
    "gain": (-1.319, -1.067),
    "bright": (2.151, 1.993),
    "constant": (-3.311, -6.536),
}
"""The weight of each feature; and without size, where the features of geometry have no weight."""
NAMES = tuple(_WEIGHTS_OF)
WEIGHTS: dict[Use, tuple[float, ...]] = {
    "all": tuple(full for full, _ in _WEIGHTS_OF.values()),
    "no size": tuple(colors for _, colors in _WEIGHTS_OF.values()),
}
SHORTLIST = 16  # number of assets that are aligned with a candidate's points
PAINTED = 10  # number of them that are compared in colour
SHIFTS = (-4, -3, -2, -1, 0, 1)  # shifts of brightness by the light, in levels of a histogram
_SLACK = 0.004  # error of a measured extent, m
_SURE = 0.6  # share of matching pixels of an asset that tells the light
_FEWEST, _USUAL = 30, 500  # least and usual number of pixels of a candidate
_THINNEST, _NARROWEST, _LONGEST, _SLENDER = 0.006, 0.012, 0.6, 25  # m, m, m, ratio of the extents of an object
_AGREEMENT, _PATTERN = 5.0, 2.0  # scales of these features
_LETTERS = 3.0  # log odds of a printed word of the asset; chosen, not fitted
_CERTAIN = 0.95  # above this likelihood no text is read


@dataclass(frozen=True)
class TriedAsset:
    """An asset tried for a candidate."""

    asset: int  # its index in `ComparedAssets`
    poses: AlignedPoses  # its best poses
    colors: ColorAgreement | None  # ``None`` with too few pixels
    similarity: float  # of the colour histograms, 0..1, in the best light
    large: float  # large, small: excess and deficit of the candidate's size: sums of log ratios
    small: float

    @property
    def best_pose_index(self) -> int:
        """Index of the pose with the best colours."""
        return 0 if self.colors is None else self.colors.rank


def shortlist_and_fit_assets(
    compared: ComparedAssets,
    seen: SegmentFeatures,
    frame: RGBDFrame,
    table: TableFrame,
    similarity: Array,
    sized: bool = True,
) -> list[TriedAsset]:
    """Align and compare the assets with the best colour ``similarity`` (A,) and, where ``sized``, size."""
    sizes = np.log(compared.sizes + _SLACK)
    large = np.clip(np.log(np.sort(seen.extents) + _SLACK) - sizes, 0, None).sum(axis=1)
    small = np.clip(sizes - np.log(np.sort(seen.upright.size) + _SLACK), 0, None).sum(axis=1)
    glance = similarity - (0.06 * np.minimum(3 * large + small, 4) if sized else 0.0)
    order: list[int] = np.argsort(-glance, kind="stable")[:SHORTLIST].tolist()
    start = compute_alignment_start(seen, table)
    poses = [align_asset_to_points(compared.appearances[number], start, seen, frame, table) for number in order]
    scores = [
        glance[number] - (40 * aligned.pose_costs[0] if sized else 0.0)
        for number, aligned in zip(order, poses, strict=True)
    ]
    best: list[int] = np.argsort(-np.array(scores), kind="stable")[:PAINTED].tolist()
    return [
        TriedAsset(
            order[index],
            poses[index],
            compare_colors(compared.appearances[order[index]], poses[index], seen),
            float(similarity[order[index]]),
            float(large[order[index]]),
            float(small[order[index]]),
        )
        for index in best
    ]


def estimate_light(tried: Sequence[Sequence[TriedAsset]]) -> Light:
    """The light of a scene, from the best fitting asset of each candidate."""

    def fit_in_daylight(item: TriedAsset) -> float:
        agreement = 0.0 if item.colors is None else item.colors.matching_pixel_fraction(DAYLIGHT)
        cost = float(item.poses.residual[item.best_pose_index] + item.poses.free_space[item.best_pose_index])
        return 3 * agreement + 2 * item.similarity - 200 * cost

    best = [max(tried_assets, key=fit_in_daylight) for tried_assets in tried if tried_assets]
    sure = [
        item.colors
        for item in best
        if item.colors is not None and item.colors.matching_pixel_fraction(DAYLIGHT) > _SURE
    ]
    if len(sure) < 3:
        return DAYLIGHT
    tint = np.median([colors.mean_hue_shift for colors in sure], axis=0)
    return Light(float(np.median([colors.gain for colors in sure])), np.asarray(tint, np.float64), 0.15)


def build_ranking_features(
    tried_assets: Sequence[TriedAsset], seen: SegmentFeatures, light: Light, similarity: Array
) -> Array:
    """Features (P, len(NAMES)) of the assets tried for a candidate.

    Args:
        tried_assets: the assets.
        seen: the candidate.
        light: the light of the scene.
        similarity: (A,) of the colours of all assets in that light.
    """
    residual = np.array([min(1000 * float(item.poses.residual[item.best_pose_index]), 8.0) for item in tried_assets])
    agreement, pattern = (np.zeros(len(tried_assets)) for _ in range(2))
    tint, gain = np.full(len(tried_assets), 0.5), np.ones(len(tried_assets))
    for index, item in enumerate(tried_assets):
        if item.colors is not None:
            agreement[index], pattern[index] = item.colors.matching_pixel_fraction(light), item.colors.pattern
            tint[index], gain[index] = (
                np.abs(item.colors.mean_hue_shift - light.tint).sum(),
                item.colors.gain - light.gain,
            )
    features = {
        "free space": [min(1000 * float(item.poses.free_space[item.best_pose_index]), 10.0) for item in tried_assets],
        "large": [item.large for item in tried_assets],
        "small": [min(item.small, 3.0) for item in tried_assets],
        "height": [min(max(100 * float(item.poses.height[item.best_pose_index]), 0.0), 5.0) for item in tried_assets],
        "residual behind": residual - residual.min(),
        "residual x pixels": residual * np.log(max(seen.pixels, _FEWEST) / _USUAL),
        "colors": [10 * float(similarity[item.asset]) for item in tried_assets],
        "agreement": _AGREEMENT * agreement,
        "agreement behind": _AGREEMENT * (agreement - agreement.max()),
        "pattern": _PATTERN * pattern,
        "pattern behind": _PATTERN * (pattern - pattern.max()),
        "tint": 5 * np.minimum(tint, 1),
        "gain": 3 * np.minimum(np.abs(gain), 1),
        "bright": 3 * np.clip(gain, 0, 1),
        "constant": np.ones(len(tried_assets)),
    }
    return np.column_stack([features[name] for name in NAMES])


def _color_similarity(
    compared: ComparedAssets, observed: Sequence[SegmentFeatures], light: Light, price: float
) -> Array:
    """Colour similarity (N, A) of the most similar view; brightness other than that of ``light`` costs ``price``."""
    histograms = np.stack([seen.untinted_color_histogram(light.tint) for seen in observed])
    shifted = np.stack([shift_histogram_brightness(histograms, -shift) for shift in SHIFTS], axis=1)
    views = compared.views.reshape(-1, compared.views.shape[-1])
    alike = views @ shifted.reshape(-1, views.shape[-1]).T  # of all candidates at once: several times as fast
    alike = alike.reshape(*compared.views.shape[:2], len(observed), len(SHIFTS)).max(axis=1)
    prices = price * np.abs(np.array(SHIFTS) - light.gain / LEVEL_WIDTH)
    return np.asarray((alike - prices).max(axis=2).T, np.float64)


@dataclass(frozen=True)
class RankedAssets:
    """The assets that were tried for a candidate, the likeliest first."""

    names: tuple[str, ...]
    likelihoods: tuple[float, ...]  # of each; the rest to 1 is the likelihood of none of them
    reasons: tuple[str, ...]  # evidence for each, in words
    confidence_inputs: Array  # (P, len(INPUTS)), as in `confidence`
    confidences: tuple[float, ...]  # probability of each to be right

    def confidence_of(self, name: str) -> float:
        """The probability of an asset to be right; 0 if it was not tried."""
        return self.confidences[self.names.index(name)] if name in self.names else 0.0


NOTHING_RANKED = RankedAssets((), (), (), np.zeros((0, len(INPUTS))), ())


def rank_assets_for_candidates(
    compared: ComparedAssets,
    observed: Sequence[SegmentFeatures],
    frame: RGBDFrame,
    table: TableFrame,
    use: Use = "all",
    read: Callable[[SegmentFeatures], Sequence[str]] | None = None,
) -> list[RankedAssets]:
    """Rank the assets for each candidate of a photo; all candidates together, since they share their light.

    ``read`` reads the words on a candidate: only in case of doubt, since reading takes longest.
    """
    glance = _color_similarity(compared, observed, DAYLIGHT, 0.02)
    tried = [
        shortlist_and_fit_assets(compared, seen, frame, table, alike, use == "all")
        for seen, alike in zip(observed, glance, strict=True)
    ]
    light = estimate_light(tried)
    found: list[RankedAssets] = []
    similarity = _color_similarity(compared, observed, light, 0.05)
    for tried_assets, seen, alike in zip(tried, observed, similarity, strict=True):
        features = build_ranking_features(tried_assets, seen, light, alike)
        letters = np.zeros(len(tried_assets))
        if (
            read is not None
            and asset_likelihoods(features, WEIGHTS[use]).max(initial=0.0) < _CERTAIN
            and not explain_implausible_object(seen)
        ):
            words = read(seen)
            letters = np.array([score_word_match(words, compared.assets[item.asset]) for item in tried_assets])
        likelihoods = asset_likelihoods(features, WEIGHTS[use], letters)
        order: list[int] = np.argsort(-likelihoods, kind="stable").tolist()
        views = [compared.views[item.asset] for item in tried_assets]
        looks_same = np.array([[np.array_equal(first, second) for second in views] for first in views], np.bool_)
        agreement, pattern, large = (features[:, NAMES.index(name)] for name in ("agreement", "pattern", "large"))
        inputs = confidence_inputs(likelihoods, looks_same, agreement / _AGREEMENT, pattern / _PATTERN, large)[order]
        found.append(
            RankedAssets(
                names=tuple(compared.assets[tried_assets[index].asset].name for index in order),
                likelihoods=tuple(float(likelihoods[index]) for index in order),
                reasons=tuple(
                    _describe_asset_fit(tried_assets[index], features[index], letters[index] > 0, use)
                    for index in order
                ),
                confidence_inputs=inputs,
                confidences=tuple(float(value) for value in asset_confidences(inputs)),
            )
        )
    return found


def asset_likelihoods(features: Array, weights: Sequence[float], letters: Array | float = 0.0) -> Array:
    """Likelihoods (P,) of assets from their features (P, len(NAMES)) and the support (P,) of words that were read."""
    scores = np.clip(features @ np.asarray(weights) + _LETTERS * letters, -60, 60)
    odds = np.exp(scores)
    return np.asarray(odds / (1 + odds.sum()), np.float64)


def explain_implausible_object(seen: SegmentFeatures) -> str:
    """Reason why a candidate is no plausible object; empty if it is."""
    low, middle, high = sorted(seen.upright.size)
    if seen.pixels < _FEWEST:
        return f"only {seen.pixels} of its pixels have a depth"
    if low < _THINNEST or middle < _NARROWEST or high > min(_LONGEST, _SLENDER * low):
        return f"{100 * low:.1f} x {100 * middle:.1f} x {100 * high:.1f} cm is no plausible object"
    return ""


def _describe_asset_fit(item: TriedAsset, features: Array, printed: bool, use: Use) -> str:
    values = dict(zip(NAMES, features.tolist(), strict=True))
    reason = f"tones {10 * values['colors']:.0f} % alike"
    if use != "no size":
        residual = float(item.poses.residual[item.best_pose_index])
        reason = (
            f"its surface is {1000 * residual:.1f} mm off the points, {reason}, "
            f"{100 / _AGREEMENT * values['agreement']:.0f} % of what is seen of it has the photo's colour"
        )
    return reason + (", and its name is printed on it" if printed else "")
