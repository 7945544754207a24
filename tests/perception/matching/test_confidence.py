"""Confidence is a probability: more evidence raises it, and an object that the library lacks is not named with it."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from evals.synthesis import Recipe
from grs_agents.library.asset import Asset
from grs_agents.library.library import Library
from grs_agents.perception.matching.confidence import asset_confidences, confidence_inputs, confidence_of_fitting_asset
from grs_agents.perception.matching.feature_matcher import match_by_features, rank_assets_per_segment
from tests.perception.matching.photo import request_of

shares = st.floats(0.001, 0.9)


def confidences(likelihoods: list[float], alike: np.ndarray, agreement: float = 0.6, large: float = 0.0) -> np.ndarray:
    count = len(likelihoods)
    same, zero = np.ones(count), np.zeros(count)
    return asset_confidences(
        confidence_inputs(np.array(likelihoods), alike, agreement * same, 0.2 * same, large + zero)
    )


@given(shares, shares, st.floats(0, 0.5), st.floats(0, 1))
def test_more_evidence_is_never_less_confidence(first: float, second: float, large: float, agreement: float) -> None:
    low, high = sorted((first, second))
    rest = (1 - high) / 2
    weak, strong = (float(confidences([own, rest], np.eye(2, dtype=bool))[0]) for own in (low, high))
    assert 0 < weak <= strong < 1
    worse = confidences([high, rest], np.eye(2, dtype=bool), 0.6 * agreement, large)
    assert float(worse[0]) <= strong


@given(st.floats(0.1, 0.9))
def test_assets_that_look_the_same_share_what_is_said_of_them(likelihood: float) -> None:
    alone = confidences([likelihood, 0.05], np.eye(2, dtype=bool))
    twins = np.array([[True, True, False], [True, True, False], [False, False, True]])
    assert confidences([likelihood / 2, likelihood / 2, 0.05], twins)[:2] == pytest.approx(alone[0])


@given(st.floats(0, 1), st.floats(0, 1))
def test_an_asset_that_fits_is_more_surely_right_and_in_the_same_order(first: float, second: float) -> None:
    low, high = sorted((first, second))
    assert low - 1e-4 <= confidence_of_fitting_asset(low) <= confidence_of_fitting_asset(high) <= 1
    assert confidence_of_fitting_asset(0.5) == pytest.approx(0.8)


class Without(Library):
    """The shipped library without one asset."""

    gone = ""

    def everyday_assets(self) -> tuple[Asset, ...]:
        return tuple(asset for asset in super().everyday_assets() if asset.name != self.gone)


def test_an_asset_that_the_library_lacks_is_not_named_with_confidence() -> None:
    library = Without()
    request, names = request_of(Recipe(seed=3, objects=4, distractors=1, tilt=45, width=480, height=360), library)
    ranked = {number: order for number, (order, _) in rank_assets_per_segment(request, library).items()}
    number = max((one for one, name in names.items() if name), key=lambda one: ranked[one].confidences[0])
    assert ranked[number].names[0] == names[number]
    assert ranked[number].confidences[0] > 0.7
    library.gone = names[number]
    answer = match_by_features(request, library).matches[number]
    assert rank_assets_per_segment(request, library)[number][0].confidence_of(names[number]) == 0
    assert answer.match == "no_asset"
    assert answer.runner_up is not None
