"""The best version of the programs: the latest of those with the highest score."""

from typing import Any

import pytest

from grs_agents.graph.fix_history import record_outcome
from grs_agents.graph.state import RunState
from grs_agents.sandbox.protocol.report import TestReport
from tests.graph.conftest import with_


def judged(outcomes: list[str]) -> dict[str, Any]:
    """The update of a run of the tests with these outcomes."""
    cases = [{"id": f"T.test_{number}", "outcome": outcome} for number, outcome in enumerate(outcomes)]
    return {"report": TestReport.model_validate({"outcome": "failed", "cases": cases})}


@pytest.mark.parametrize(("second", "best"), [(["passed", "failed"], 2), (["failed", "failed"], 1)])
def test_an_equally_good_later_version_replaces_the_best(state: RunState, second: list[str], best: int) -> None:
    first = record_outcome(with_(state, simulation_version=1, tests_version=1), judged(["passed", "failed"]))
    assert first["best"].simulation_version == 1
    later = with_(state, simulation_version=2, tests_version=1, best=first["best"])
    change = record_outcome(later, judged(second))
    assert change.get("best", first["best"]).simulation_version == best
