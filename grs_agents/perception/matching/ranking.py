"""From numbers to likelihoods: which asset stands for a candidate, if any, and how sure that is.

The likelihoods are those of a choice between the assets that were tried and none of them (a conditional logit,
McFadden 1974). Its weights were fitted to scenes of `grs_agents.synth` that no reported figure is measured on.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from grs_agents.perception.frame import Array
from grs_agents.perception.matching.catalogue import Catalogue
from grs_agents.perception.matching.features import GEOMETRY, NAMES, Pair, light_of, numbers, pairs
from grs_agents.perception.matching.observation import Observation, View
from grs_agents.perception.matching.printed_text import support

Use = Literal["all", "no size"]
_THINNEST, _NARROWEST, _LONGEST, _SLENDER = 0.006, 0.012, 0.6, 25
_FEWEST = 30
_LETTERS = 3.0
"""What a word that is spelt as the asset's counts, in natural logarithms of odds; chosen, not fitted."""
_CERTAIN = 0.95
"""What is likelier than this without letters is not read."""
WEIGHTS: dict[Use, tuple[float, ...]] = {
    "all": (
        -0.468,
        -2.253,
        -1.39,
        -0.242,
        -0.517,
        -0.109,
        1.561,
        -1.583,
        2.835,
        4.955,
        -2.405,
        -0.937,
        -1.319,
        2.151,
        -3.311,
    ),
    "no size": (0.0,) * len(GEOMETRY) + (1.651, -1.961, 3.448, 5.432, -2.61, -1.361, -1.067, 1.993, -6.536),
}
"""One for each of `grs_agents.perception.matching.features.NAMES`; without size, those of geometry count nothing."""


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
        tuple(
            _reason(
                dict(zip(NAMES, told[index].tolist(), strict=True)), float(some[index].laid.off[some[index].rank]), use
            )
            + (", and its name is printed on it" if letters[index] else "")
            for index in order
        ),
    )


def _reason(told: dict[str, float], off: float, use: Use) -> str:
    colors = f"tones {10 * told['tones']:.0f} % alike"
    if use == "no size":
        return colors
    return (
        f"its surface is {1000 * off:.1f} mm off the points, {colors}, "
        f"{20 * told['agreement']:.0f} % of what is seen of it has the photo's colour"
    )
