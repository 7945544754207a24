"""Features of how well assets fit a candidate (size, place, tones, colours, pattern), and the likelihoods they give.

The likelihoods are those of a choice between the assets that were tried and none of them (a conditional logit,
McFadden 1974). Its weights were fitted to scenes of `evals.synthesis` that no reported figure is measured on.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from grs_agents.perception.matching.alignment import AlignedPoses, align, approach_of
from grs_agents.perception.matching.asset_appearance import Catalogue
from grs_agents.perception.matching.color_agreement import DAYLIGHT, Light, Painted, paint
from grs_agents.perception.matching.color_histogram import brightness_shifts
from grs_agents.perception.matching.observation import Observation, View
from grs_agents.perception.matching.printed_text import support
from grs_agents.perception.types import Array

Use = Literal["all", "no size"]
_WEIGHTS_OF: dict[str, tuple[float, float]] = {
    "air": (-0.468, 0),
    "large": (-2.253, 0),
    "small": (-1.39, 0),
    "lift": (-0.242, 0),
    "off behind": (-0.517, 0),
    "off x pixels": (-0.109, 0),
    "tones": (1.561, 1.651),
    "agreement": (-1.583, -1.961),
    "agreement behind": (2.835, 3.448),
    "pattern": (4.955, 5.432),
    "pattern behind": (-2.405, -2.61),
    "tint": (-0.937, -1.361),
    "gain": (-1.319, -1.067),
    "bright": (2.151, 1.993),
    "one": (-3.311, -6.536),
}
"""The weight of each feature with all that is known; and without size, where those of geometry count nothing."""
NAMES = tuple(_WEIGHTS_OF)
WEIGHTS: dict[Use, tuple[float, ...]] = {
    "all": tuple(full for full, _ in _WEIGHTS_OF.values()),
    "no size": tuple(colors for _, colors in _WEIGHTS_OF.values()),
}
SHORTLIST = 16
"""So many assets are aligned with a candidate's points."""
PAINTED = 10
"""So many of them are compared in colour."""
SHIFTS = (-4, -3, -2, -1, 0, 1)
"""Light may move brightness by so many levels of a histogram."""
_LEVEL = 0.3
_SLACK = 0.004
"""Every extent may be wrong by this much, m."""
_SURE = 0.6
_FEWEST, _USUAL = 30, 500
"""A candidate has at least so many pixels, and often so many."""
_THINNEST, _NARROWEST, _LONGEST, _SLENDER = 0.006, 0.012, 0.6, 25
_LETTERS = 3.0
"""What a word that is spelt as the asset's counts, in natural logarithms of odds; chosen, not fitted."""
_CERTAIN = 0.95
"""What is likelier than this without letters is not read."""


@dataclass(frozen=True)
class Pair:
    """An asset tried for a candidate.

    Attributes:
        asset: its number in the catalogue.
        laid: where it may lie.
        painted: how its colours agree; ``None`` where too little of it would be seen.
        tones: how alike the tones are, 0..1, in the best light.
        large, small: by how much the candidate is larger or smaller than the asset: sums of logarithms.
    """

    asset: int
    laid: AlignedPoses
    painted: Painted | None
    tones: float
    large: float
    small: float

    @property
    def rank(self) -> int:
        """Which of the poses it is."""
        return 0 if self.painted is None else self.painted.rank


def pairs(catalogue: Catalogue, seen: Observation, view: View, sized: bool = True) -> list[Pair]:
    """Try the assets that are most like a candidate at first glance.

    Args:
        catalogue: the assets.
        seen, view: the candidate and the photo.
        sized: go by size as well as by colour.
    """
    large, small = _sizes(catalogue, seen)
    tones = _tones(catalogue, seen, DAYLIGHT, 0.02)
    glance = tones - (0.06 * np.minimum(3 * large + small, 4) if sized else 0.0)
    order: list[int] = np.argsort(-glance, kind="stable")[:SHORTLIST].tolist()
    approach = approach_of(seen, view)
    laid = [align(catalogue.looks[number], approach, seen, view) for number in order]
    scores = [glance[number] - (40 * one.misfit[0] if sized else 0.0) for number, one in zip(order, laid, strict=True)]
    best: list[int] = np.argsort(-np.array(scores), kind="stable")[:PAINTED].tolist()
    return [
        Pair(
            order[index],
            laid[index],
            paint(catalogue.looks[order[index]], laid[index], seen),
            float(tones[order[index]]),
            float(large[order[index]]),
            float(small[order[index]]),
        )
        for index in best
    ]


def light_of(tried: Sequence[Sequence[Pair]]) -> Light:
    """The light of a scene, from the assets that fit best of all its candidates."""
    best = [max(some, key=_plausible) for some in tried if some]
    sure = [one.painted for one in best if one.painted is not None and one.painted.agreement(DAYLIGHT) > _SURE]
    if len(sure) < 3:
        return DAYLIGHT
    tint = np.median([one.tint for one in sure], axis=0)
    return Light(float(np.median([one.gain for one in sure])), np.asarray(tint, np.float64), 0.15)


def numbers(catalogue: Catalogue, some: Sequence[Pair], seen: Observation, light: Light) -> Array:
    """(P, len(NAMES)) what is known of pairs of one candidate, once the light of the scene is known."""
    tones = _tones(catalogue, seen, light, 0.05, [one.asset for one in some])
    off = np.array([min(1000 * float(one.laid.off[one.rank]), 8.0) for one in some])
    agreement, pattern = (np.zeros(len(some)) for _ in range(2))
    tint, gain = np.full(len(some), 0.5), np.ones(len(some))
    for index, one in enumerate(some):
        if one.painted is not None:
            agreement[index], pattern[index] = one.painted.agreement(light), one.painted.pattern
            tint[index], gain[index] = np.abs(one.painted.tint - light.tint).sum(), one.painted.gain - light.gain
    told = {
        "air": [min(1000 * float(one.laid.air[one.rank]), 10.0) for one in some],
        "large": [one.large for one in some],
        "small": [min(one.small, 3.0) for one in some],
        "lift": [min(max(100 * float(one.laid.lift[one.rank]), 0.0), 5.0) for one in some],
        "off behind": off - off.min(),
        "off x pixels": off * np.log(max(seen.pixels, _FEWEST) / _USUAL),
        "tones": 10 * tones,
        "agreement": 5 * agreement,
        "agreement behind": 5 * (agreement - agreement.max()),
        "pattern": 2 * pattern,
        "pattern behind": 2 * (pattern - pattern.max()),
        "tint": 5 * np.minimum(tint, 1),
        "gain": 3 * np.minimum(np.abs(gain), 1),
        "bright": 3 * np.clip(gain, 0, 1),
        "one": np.ones(len(some)),
    }
    return np.column_stack([told[name] for name in NAMES])


def _plausible(one: Pair) -> float:
    """A first guess of how well a pair fits, before the light is known."""
    agreement = 0.0 if one.painted is None else one.painted.agreement(DAYLIGHT)
    return 3 * agreement + 2 * one.tones - 200 * float(one.laid.off[one.rank] + one.laid.air[one.rank])


def _sizes(catalogue: Catalogue, seen: Observation) -> tuple[Array, Array]:
    """(A,) by how much the candidate is larger, and smaller, than each asset."""
    sizes = np.log(catalogue.sizes + _SLACK)
    large = np.log(np.sort(seen.extents) + _SLACK) - sizes
    small = sizes - np.log(np.sort(seen.upright.size) + _SLACK)
    return np.clip(large, 0, None).sum(axis=1), np.clip(small, 0, None).sum(axis=1)


def _tones(
    catalogue: Catalogue, seen: Observation, light: Light, price: float, numbers: Sequence[int] | None = None
) -> Array:
    """(A,) how alike the tones of the most alike view are; a light that differs from ``light`` has its price."""
    views = catalogue.views if numbers is None else catalogue.views[list(numbers)]
    own = seen.histogram(light.tint)[None]
    asked = np.concatenate([brightness_shifts(own, -shift) for shift in SHIFTS])
    alike = (views.reshape(-1, views.shape[-1]) @ asked.T).reshape(*views.shape[:2], -1).max(axis=1)
    prices = price * np.abs(np.array(SHIFTS) - light.gain / _LEVEL)
    return np.asarray((alike - prices).max(axis=1), np.float64)


@dataclass(frozen=True)
class Ranked:
    """The assets that were tried for a candidate, the likeliest first.

    Attributes:
        names: of the assets.
        likelihoods: of each; what is missing to 1 is the likelihood that it is none of them.
        reasons: what speaks for each, in words.
    """

    names: tuple[str, ...]
    likelihoods: tuple[float, ...]
    reasons: tuple[str, ...]


def rank(
    catalogue: Catalogue,
    observed: Sequence[Observation],
    view: View,
    use: Use = "all",
    read: Callable[[Observation], Sequence[str]] | None = None,
) -> list[Ranked]:
    """Rank the assets for each candidate of a photo.

    Args:
        catalogue: the assets.
        observed, view: the candidates, all together, since they share their light; and the photo.
        use: all that is known, or colours alone.
        read: reads the words on a candidate; asked where the rest leaves a doubt, since reading takes longest.
    """
    tried = [pairs(catalogue, seen, view, use == "all") for seen in observed]
    light = light_of(tried)
    found: list[Ranked] = []
    for some, seen in zip(tried, observed, strict=True):
        told = numbers(catalogue, some, seen, light)
        letters = np.zeros(len(some))
        if read is not None and likelihoods(told, WEIGHTS[use]).max(initial=0.0) < _CERTAIN and not implausible(seen):
            words = read(seen)
            letters = np.array([support(words, catalogue.assets[one.asset]) for one in some])
        found.append(_ranked(catalogue, some, told, letters, use))
    return found


def likelihoods(told: Array, weights: Sequence[float], letters: Array | float = 0.0) -> Array:
    """(P,) of each asset, beside none of them, from numbers (P, len(NAMES)) and the support (P,) of what was read."""
    scores = np.clip(told @ np.asarray(weights) + _LETTERS * letters, -60, 60)
    odds = np.exp(scores)
    return np.asarray(odds / (1 + odds.sum()), np.float64)


def implausible(seen: Observation) -> str:
    """Why a candidate is no object at all; empty if it may be one."""
    low, middle, high = sorted(seen.upright.size)
    if seen.pixels < _FEWEST:
        return f"only {seen.pixels} of its pixels have a depth"
    if low < _THINNEST or middle < _NARROWEST or high > min(_LONGEST, _SLENDER * low):
        return f"{100 * low:.1f} x {100 * middle:.1f} x {100 * high:.1f} cm is no plausible object"
    return ""


def _ranked(catalogue: Catalogue, some: Sequence[Pair], told: Array, letters: Array, use: Use) -> Ranked:
    likely = likelihoods(told, WEIGHTS[use], letters)
    order: list[int] = np.argsort(-likely, kind="stable").tolist()
    return Ranked(
        tuple(catalogue.assets[some[index].asset].name for index in order),
        tuple(float(likely[index]) for index in order),
        tuple(_reason(some[index], told[index], letters[index] > 0, use) for index in order),
    )


def _reason(one: Pair, told: Array, printed: bool, use: Use) -> str:
    values = dict(zip(NAMES, told.tolist(), strict=True))
    reason = f"tones {10 * values['tones']:.0f} % alike"
    if use != "no size":
        reason = (
            f"its surface is {1000 * float(one.laid.off[one.rank]):.1f} mm off the points, {reason}, "
            f"{20 * values['agreement']:.0f} % of what is seen of it has the photo's colour"
        )
    return reason + (", and its name is printed on it" if printed else "")
