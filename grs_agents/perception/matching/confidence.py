"""Confidence in a matched asset, where the library may lack the object of the photo.

Logistic regression (Platt 1999) on the likelihood among the tried assets, the margin to the best asset of another look,
the agreement of colours and pattern, and the excess of the object's size.
"""

import numpy as np

from grs_agents.perception.types import Array, Mask

INPUTS = ("log odds", "margin", "agreement", "pattern", "large")
COEFFICIENTS = (-3.6, 0.57, 0.237, 2.33, 3.69, -1.1)
"""The constant and the weight of each input, fitted by ``grs eval confidence --fit`` to synthesised scenes; the library
holds the objects of 23 % of their segments (seeds 75000, 76000, 77000, 79000: 164 scenes of 15 objects in a bin, with
all and with half of their assets in the library; segments of ``segment_rgbd``)."""
_FITTING = 4.0
"""Factor of the odds of an asset that fits the measured size after registration: of 130 in the scenes of seed 78000
98.5 % were right, at a mean confidence of .91 before."""
_FARTHEST = 5.0  # bound on the margin (natural logarithm): few assets have the shape
_LEAST = 1e-6


def confidence_inputs(likelihoods: Array, alike: Mask, agreement: Array, pattern: Array, large: Array) -> Array:
    """Inputs (P, len(INPUTS)) of the regression for each tried asset.

    Args:
        likelihoods: (P,) of each beside the others and none of them.
        alike: (P, P) pairs of the same look, whose likelihoods add up.
        agreement: (P,) share of the pixels that have the asset's colour.
        pattern: (P,) log ratio of the misfits of a plain colour and of its pattern.
        large: (P,) excess of the candidate's size: sum of log ratios.
    """
    likelihood = np.clip(alike @ likelihoods, _LEAST, 1 - _LEAST)
    rival = np.maximum(np.where(alike, 0.0, likelihoods).max(axis=1, initial=0.0), _LEAST)
    margin = np.clip(np.log(likelihood / rival), -_FARTHEST, _FARTHEST)
    return np.column_stack([np.log(likelihood / (1 - likelihood)), margin, agreement, pattern, large])


def asset_confidences(inputs: Array) -> Array:
    """Probabilities (P,) of assets to be right, from their inputs (P, len(INPUTS))."""
    constant, *weights = COEFFICIENTS
    return np.asarray(1 / (1 + np.exp(-(constant + inputs @ np.array(weights)))), np.float64)


def confidence_of_fitting_asset(confidence: float) -> float:
    """The confidence in a registered asset of the measured size, from its confidence before registration."""
    odds = _FITTING * confidence / max(1 - confidence, _LEAST)
    return round(odds / (1 + odds), 4)
