"""What a match tool answers reaches the scene only where the asset is likely enough to be the right one."""

import pytest

from grs_agents.graph.recognition import drop_asset_below_confidence
from grs_agents.perception.configuration import DEFAULT
from grs_agents.perception.types import MatchEvidence

LEAST = DEFAULT.matching.least
NAMED = MatchEvidence(match="asset", asset="HOPE/Milk.urdf", method="match_features", reason="it fits")


@pytest.mark.parametrize("sure", [None, LEAST, 1.0])
def test_a_likely_asset_stays(sure: float | None) -> None:
    answer = NAMED.model_copy(update={"confidence": sure})
    assert drop_asset_below_confidence(answer) == answer


def test_a_doubtful_asset_gives_way_to_a_proxy() -> None:
    found = drop_asset_below_confidence(NAMED.model_copy(update={"confidence": LEAST - 0.01, "scores": {"a": 0.6}}))
    assert (found.match, found.asset, found.runner_up) == ("no_asset", None, "HOPE/Milk.urdf")
    assert found.confidence == pytest.approx(1.01 - LEAST)
    assert (found.method, found.scores) == ("match_features", {"a": 0.6})
    assert "it fits" in found.reason


def test_what_is_no_asset_stays_what_it_is() -> None:
    answer = MatchEvidence(match="no_asset", confidence=0.55)
    assert drop_asset_below_confidence(answer) == answer
