"""A hand that misses: four episodes decide, and a fifth only where one of them failed."""

from typing import Any

import pytest

from grs_agents.graph.judging import audit_task
from grs_agents.graph.services import Services
from grs_agents.graph.state import RunState
from tests.graph.conftest import Make, run, with_


@pytest.mark.parametrize(
    ("failing", "told", "passed"),
    [(0, "4 of 4 with 5 mm", True), (1, "4 of 5 with 5 mm", True), (2, "2 of 4 with 5 mm", False)],
)
def test_a_fifth_episode_runs_only_where_it_decides(
    failing: int, told: str, passed: bool, state: RunState, make_services: Make, monkeypatch: pytest.MonkeyPatch
) -> None:
    whole = Services.run_tool

    def fail_some(services: Services, name: str, **request: Any) -> Any:
        result = whole(services, name, **request)
        if name == "rollout":
            for trial in result.rollout["trials"][:failing]:
                trial["score"] = 0.0
        return result

    monkeypatch.setattr(Services, "run_tool", fail_some)
    report = run(audit_task, with_(state, tests=...), make_services())["audit"]
    [finding] = [one for one in report.findings if one.check == "sure_hand"]
    assert told in finding.measured and finding.passed == passed
