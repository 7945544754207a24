"""Features of how well assets fit a candidate (size, place, colours, pattern), and the likelihoods they give.

The likelihoods are those of a choice between the assets that were tried and none of them (a conditional logit,
McFadden 1974). Its weights were fitted to scenes of `evals.synthesis` that no reported figure is measured on.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from grs_agents.perception.matching.asset_appearance import ComparedAssets
from grs_agents.perception.matching.color_agreement import DAYLIGHT, ColorAgreement, Light, compare_colors
from grs_agents.perception.matching.color_histogram import shift_histogram_brightness
from grs_agents.perception.matching.confidence import INPUTS, asset_confidences, confidence_inputs
from grs_agents.perception.matching.observation import Observation, View
from grs_agents.perception.matching.pose_alignment import AlignedPoses, align_asset_to_points, compute_alignment_start
from grs_agents.perception.matching.printed_text import score_word_match
from grs_agents.perception.types import Array

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
"""The weight of each feature with all that is known; and without size, where those of geometry count nothing."""
NAMES = tuple(_WEIGHTS_OF)
WEIGHTS: dict[Use, tuple[float, ...]] = {
    "all": tuple(full for full, _ in _WEIGHTS_OF.values()),
    "no size": tuple(colors for _, colors in _WEIGHTS_OF.values()),
}
SHORTLIST = 16  # so many assets are aligned with a candidate's points
PAINTED = 10  # so many of them are compared in colour
SHIFTS = (-4, -3, -2, -1, 0, 1)  # light may move brightness by so many levels of a histogram
_LEVEL = 0.3
_SLACK = 0.004  # every extent may be wrong by this much, m
_SURE = 0.6
_FEWEST, _USUAL = 30, 500  # a candidate has at least so many pixels, and often so many
_THINNEST, _NARROWEST, _LONGEST, _SLENDER = 0.006, 0.012, 0.6, 25
_AGREEMENT, _PATTERN = 5.0, 2.0  # units of these features
_LETTERS = 3.0  # what a word that is spelt as the asset's counts, in natural logarithms of odds; chosen, not fitted
_CERTAIN = 0.95  # what is likelier than this without letters is not read


@dataclass(frozen=True)
class TriedAsset:
    """An asset tried for a candidate."""

    asset: int  # its number in the catalogue
    poses: AlignedPoses  # where it may lie
    colors: ColorAgreement | None  # how its colours agree; ``None`` where too little of it would be seen
    similarity: float  # how alike the histograms of colour are, 0..1, in the best light
    large: float  # large, small: by how much the candidate is larger or smaller than the asset: sums of logarithms
    small: float

    @property
    def best_pose_index(self) -> int:
        """Which of the poses it is."""
        return 0 if self.colors is None else self.colors.rank


def shortlist_and_fit_assets(
    compared: ComparedAssets, seen: Observation, view: View, similarity: Array, sized: bool = True
) -> list[TriedAsset]:
    """Try the assets that are most like a candidate at first glance, by colour (``similarity`` (A,)), and by size
    where it is ``sized``."""
    large, small = _size_excess_and_deficit(compared, seen)
    glance = similarity - (0.06 * np.minimum(3 * large + small, 4) if sized else 0.0)
    order: list[int] = np.argsort(-glance, kind="stable")[:SHORTLIST].tolist()
    start = compute_alignment_start(seen, view)
    poses = [align_asset_to_points(compared.appearances[number], start, seen, view) for number in order]
    scores = [
        glance[number] - (40 * one.pose_costs[0] if sized else 0.0) for number, one in zip(order, poses, strict=True)
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
    """The light of a scene, from the assets that fit best of all its candidates."""
    best = [max(tried_assets, key=_score_fit_in_daylight) for tried_assets in tried if tried_assets]
    sure = [
        one.colors for one in best if one.colors is not None and one.colors.matching_pixel_fraction(DAYLIGHT) > _SURE
    ]
    if len(sure) < 3:
        return DAYLIGHT
    tint = np.median([one.mean_hue_shift for one in sure], axis=0)
    return Light(float(np.median([one.gain for one in sure])), np.asarray(tint, np.float64), 0.15)


def build_ranking_features(
    tried_assets: Sequence[TriedAsset], seen: Observation, light: Light, similarity: Array
) -> Array:
    """(P, len(NAMES)) the features of the assets tried for one candidate, once the light of the scene is known and
    how alike the colours of all assets are in it (A,)."""
    residual = np.array([min(1000 * float(one.poses.residual[one.best_pose_index]), 8.0) for one in tried_assets])
    agreement, pattern = (np.zeros(len(tried_assets)) for _ in range(2))
    tint, gain = np.full(len(tried_assets), 0.5), np.ones(len(tried_assets))
    for index, one in enumerate(tried_assets):
        if one.colors is not None:
            agreement[index], pattern[index] = one.colors.matching_pixel_fraction(light), one.colors.pattern
            tint[index], gain[index] = (
                np.abs(one.colors.mean_hue_shift - light.tint).sum(),
                one.colors.gain - light.gain,
            )
    features = {
        "free space": [min(1000 * float(one.poses.free_space[one.best_pose_index]), 10.0) for one in tried_assets],
        "large": [one.large for one in tried_assets],
        "small": [min(one.small, 3.0) for one in tried_assets],
        "height": [min(max(100 * float(one.poses.height[one.best_pose_index]), 0.0), 5.0) for one in tried_assets],
        "residual behind": residual - residual.min(),
        "residual x pixels": residual * np.log(max(seen.pixels, _FEWEST) / _USUAL),
        "colors": [10 * float(similarity[one.asset]) for one in tried_assets],
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


def _score_fit_in_daylight(one: TriedAsset) -> float:
    """A first guess of how well a pair fits, before the light is known."""
    agreement = 0.0 if one.colors is None else one.colors.matching_pixel_fraction(DAYLIGHT)
    return (
        3 * agreement
        + 2 * one.similarity
        - 200 * float(one.poses.residual[one.best_pose_index] + one.poses.free_space[one.best_pose_index])
    )


def _size_excess_and_deficit(compared: ComparedAssets, seen: Observation) -> tuple[Array, Array]:
    """(A,) by how much the candidate is larger, and smaller, than each asset."""
    sizes = np.log(compared.sizes + _SLACK)
    large = np.log(np.sort(seen.extents) + _SLACK) - sizes
    small = sizes - np.log(np.sort(seen.upright.size) + _SLACK)
    return np.clip(large, 0, None).sum(axis=1), np.clip(small, 0, None).sum(axis=1)


def _color_similarity(compared: ComparedAssets, observed: Sequence[Observation], light: Light, price: float) -> Array:
    """(N, A) how alike the colours of the most alike view are; a light that differs from ``light`` has its price."""
    own = np.stack([seen.untinted_color_histogram(light.tint) for seen in observed])
    asked = np.stack([shift_histogram_brightness(own, -shift) for shift in SHIFTS], axis=1)
    views = compared.views.reshape(-1, compared.views.shape[-1])
    alike = views @ asked.reshape(-1, views.shape[-1]).T  # of all candidates at once, which is several times as fast
    alike = alike.reshape(*compared.views.shape[:2], len(observed), len(SHIFTS)).max(axis=1)
    prices = price * np.abs(np.array(SHIFTS) - light.gain / _LEVEL)
    return np.asarray((alike - prices).max(axis=2).T, np.float64)


@dataclass(frozen=True)
class RankedAssets:
    """The assets that were tried for a candidate, the likeliest first."""

    names: tuple[str, ...]  # of the assets
    likelihoods: tuple[float, ...]  # of each; what is missing to 1 is the likelihood that it is none of them
    reasons: tuple[str, ...]  # what speaks for each, in words
    confidence_inputs: Array  # (P, len(INPUTS)) see `confidence`
    confidences: tuple[float, ...]  # the probability that each is the right one

    def confidence_of(self, name: str) -> float:
        """The probability that it is an asset; 0 where others looked so much better that it was not tried."""
        return self.confidences[self.names.index(name)] if name in self.names else 0.0


NOTHING_RANKED = RankedAssets((), (), (), np.zeros((0, len(INPUTS))), ())


def rank_assets_for_candidates(
    compared: ComparedAssets,
    observed: Sequence[Observation],
    view: View,
    use: Use = "all",
    read: Callable[[Observation], Sequence[str]] | None = None,
) -> list[RankedAssets]:
    """Rank the assets for each candidate of a photo; all candidates together, since they share their light.

    ``read`` reads the words on a candidate: only where the rest leaves a doubt, since reading takes longest.
    """
    glance = _color_similarity(compared, observed, DAYLIGHT, 0.02)
    tried = [
        shortlist_and_fit_assets(compared, seen, view, alike, use == "all")
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
            letters = np.array([score_word_match(words, compared.assets[one.asset]) for one in tried_assets])
        found.append(_rank_by_likelihood(compared, tried_assets, features, letters, use))
    return found


def asset_likelihoods(features: Array, weights: Sequence[float], letters: Array | float = 0.0) -> Array:
    """(P,) of each asset, beside none of them, from numbers (P, len(NAMES)) and the support (P,) of what was read."""
    scores = np.clip(features @ np.asarray(weights) + _LETTERS * letters, -60, 60)
    odds = np.exp(scores)
    return np.asarray(odds / (1 + odds.sum()), np.float64)


def explain_implausible_object(seen: Observation) -> str:
    """Why a candidate is no object at all; empty if it may be one."""
    low, middle, high = sorted(seen.upright.size)
    if seen.pixels < _FEWEST:
        return f"only {seen.pixels} of its pixels have a depth"
    if low < _THINNEST or middle < _NARROWEST or high > min(_LONGEST, _SLENDER * low):
        return f"{100 * low:.1f} x {100 * middle:.1f} x {100 * high:.1f} cm is no plausible object"
    return ""


def _rank_by_likelihood(
    compared: ComparedAssets, tried_assets: Sequence[TriedAsset], features: Array, letters: Array, use: Use
) -> RankedAssets:
    likely = asset_likelihoods(features, WEIGHTS[use], letters)
    views = [compared.views[one.asset] for one in tried_assets]
    alike = np.array([[np.array_equal(one, other) for other in views] for one in views], np.bool_)
    agreement, pattern, large = (features[:, NAMES.index(name)] for name in ("agreement", "pattern", "large"))
    order: list[int] = np.argsort(-likely, kind="stable").tolist()
    inputs = confidence_inputs(likely, alike, agreement / _AGREEMENT, pattern / _PATTERN, large)[order]
    return RankedAssets(
        tuple(compared.assets[tried_assets[index].asset].name for index in order),
        tuple(float(likely[index]) for index in order),
        tuple(_describe_asset_fit(tried_assets[index], features[index], letters[index] > 0, use) for index in order),
        inputs,
        tuple(float(value) for value in asset_confidences(inputs)),
    )


def _describe_asset_fit(one: TriedAsset, features: Array, printable_words: bool, use: Use) -> str:
    values = dict(zip(NAMES, features.tolist(), strict=True))
    reason = f"tones {10 * values['colors']:.0f} % alike"
    if use != "no size":
        reason = (
            f"its surface is {1000 * float(one.poses.residual[one.best_pose_index]):.1f} mm off the points, {reason}, "
            f"{100 / _AGREEMENT * values['agreement']:.0f} % of what is seen of it has the photo's colour"
        )
    return reason + (", and its name is printed on it" if printable_words else "")
