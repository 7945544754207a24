"""How likely it is that a named asset is the right one, where the library may lack what the photo shows.

A logistic regression (Platt 1999) on what speaks for the asset: its likelihood among the assets that were tried, the
margin to the best that looks otherwise, how its colours and its pattern agree, and by how much the object is larger.
"""

import numpy as np

from grs_agents.perception.types import Array, Mask

INPUTS = ("log odds", "margin", "agreement", "pattern", "large")
COEFFICIENTS = (-3.6, 0.57, 0.237, 2.33, 3.69, -1.1)
"""The constant and the weight of each input, fitted by ``grs eval confidence --fit`` to synthesised scenes of which the
library holds 23 % of what the segments show (seeds 75000, 76000, 77000, 79000: 164 scenes of 15 objects in a bin, as
they are and with half of their assets taken out of the library; segments of ``segment_rgbd``)."""
_FITTING = 4.0
"""So many times higher are the odds of an asset that fits what was measured: of 130 in the scenes of seed 78000 98.5 %
were right, where their confidence without that was .91."""
_FARTHEST = 5.0  # a margin in natural logarithms beyond this says no more: few assets have the shape
_LEAST = 1e-6


def confidence_inputs(likelihoods: Array, alike: Mask, agreement: Array, pattern: Array, large: Array) -> Array:
    """(P, len(INPUTS)) what speaks for each of the assets that were tried for a candidate.

    Args:
        likelihoods: (P,) of each beside the others and none of them.
        alike: (P, P) which of them look the same: what is said of one is said of all of them.
        agreement: (P,) share of the pixels whose colour is the asset's.
        pattern: (P,) how much better its pattern explains them than one colour.
        large: (P,) by how much the candidate is larger: sum of logarithms.
    """
    own = np.clip(alike @ likelihoods, _LEAST, 1 - _LEAST)
    rival = np.maximum(np.where(alike, 0.0, likelihoods).max(axis=1, initial=0.0), _LEAST)
    margin = np.clip(np.log(own / rival), -_FARTHEST, _FARTHEST)
    return np.column_stack([np.log(own / (1 - own)), margin, agreement, pattern, large])


def asset_confidences(inputs: Array) -> Array:
    """(P,) the probability that each asset is the right one, from its inputs (P, len(INPUTS))."""
    constant, *weights = COEFFICIENTS
    return np.asarray(1 / (1 + np.exp(-(constant + inputs @ np.array(weights)))), np.float64)


def confidence_of_fitting_asset(confidence: float) -> float:
    """The probability that a named asset is right, given that before it was registered; it was, and has the size that
    was measured."""
    odds = _FITTING * confidence / max(1 - confidence, _LEAST)
    return round(odds / (1 + odds), 4)
