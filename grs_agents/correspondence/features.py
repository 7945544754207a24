"""How well assets fit what was seen of a candidate, in numbers: size, place, tones and colours."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from grs_agents.correspondence.catalogue import SHIFTS, Catalogue
from grs_agents.correspondence.laying import Laid, lay
from grs_agents.correspondence.observation import Observation, View
from grs_agents.correspondence.painting import DAYLIGHT, Light, Painted, paint, repaint
from grs_agents.scene.frame import Array

NAMES = ("off", "air", "large", "small", "seen", "tones", "tones behind", "agreement", "agreement behind", "tint",
         "gain", "bright", "one")  # fmt: skip
"""What `numbers` tells, in this order; the first five are about size and place."""
GEOMETRY = 5
SHORTLIST = 10
"""So many assets are laid into a candidate's points."""
_LEVEL = 0.3
_SLACK = 0.004
"""Every extent may be wrong by this much, m."""
_SURE = 0.6


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
    laid: Laid
    painted: Painted | None
    tones: float
    large: float
    small: float


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
    found: list[Pair] = []
    order: list[int] = np.argsort(-glance, kind="stable")[:SHORTLIST].tolist()
    for number in order:
        laid = lay(catalogue.looks[number], catalogue.trees[number], seen, view)
        painted = paint(catalogue.looks[number], laid, seen, view)
        found.append(Pair(number, laid, painted, float(tones[number]), float(large[number]), float(small[number])))
    return found


def light_of(tried: Sequence[Sequence[Pair]]) -> Light:
    """The light of a scene, from the assets that fit best of all its candidates."""
    best = [max(some, key=_plausible) for some in tried if some]
    sure = [one.painted for one in best if one.painted is not None and one.painted.agreement > _SURE]
    if len(sure) < 3:
        return DAYLIGHT
    tint = np.median([one.tint for one in sure], axis=0)
    return Light(float(np.median([one.gain for one in sure])), np.asarray(tint, np.float64), 0.15)


def relit(catalogue: Catalogue, some: Sequence[Pair], seen: Observation, view: View, light: Light) -> list[Pair]:
    """The same pairs, once the light is known."""
    tones = _tones(catalogue, seen, light, 0.05)
    found: list[Pair] = []
    for one in some:
        painted = one.painted
        if painted is not None:
            painted = repaint(catalogue.looks[one.asset], painted, seen, view, light)
        found.append(replace(one, painted=painted, tones=float(tones[one.asset])))
    return found


def numbers(some: Sequence[Pair], light: Light) -> Array:
    """(P, len(NAMES)) what is known of pairs of one candidate."""
    tones = np.array([one.tones for one in some])
    agreement = np.array([0.0 if one.painted is None else one.painted.agreement for one in some])
    rows: list[list[float]] = []
    for index, one in enumerate(some):
        rank = 0 if one.painted is None else one.painted.rank
        told = one.painted
        tint = 0.5 if told is None else float(np.abs(np.subtract(told.tint, light.tint)).sum())
        gain = 1.0 if told is None else told.gain - light.gain
        rows.append([
            min(1000 * float(one.laid.off[rank]), 8.0), min(1000 * float(one.laid.air[rank]), 10.0),
            one.large, min(one.small, 3.0), 0.0 if told is None else 3 * told.seen,
            10 * one.tones, 10 * (one.tones - float(tones.max())),
            5 * float(agreement[index]), 5 * float(agreement[index] - agreement.max()),
            5 * min(tint, 1.0), 3 * min(abs(gain), 1.0), 3 * max(min(gain, 1.0), 0.0), 1.0,
        ])  # fmt: skip
    return np.array(rows).reshape(len(rows), len(NAMES))


def _plausible(one: Pair) -> float:
    """A first guess of how well a pair fits, before the light is known."""
    rank, agreement = (0, 0.0) if one.painted is None else (one.painted.rank, one.painted.agreement)
    return 3 * agreement + 2 * one.tones - 200 * float(one.laid.off[rank] + one.laid.air[rank])


def _sizes(catalogue: Catalogue, seen: Observation) -> tuple[Array, Array]:
    """(A,) by how much the candidate is larger, and smaller, than each asset."""
    apart = np.log((np.sort(seen.upright.size) + _SLACK) / (catalogue.sizes + _SLACK))
    return np.clip(apart, 0, None).sum(axis=1), np.clip(-apart, 0, None).sum(axis=1)


def _tones(catalogue: Catalogue, seen: Observation, light: Light, price: float) -> Array:
    """(A,) how alike the tones of the most alike view are; a light that differs from ``light`` has its price."""
    alike = (catalogue.views @ seen.histogram(light.tint)).max(axis=2)
    prices = price * np.abs(np.array(SHIFTS) - light.gain / _LEVEL)
    return np.asarray((alike - prices[:, None]).max(axis=0), np.float64)
