"""The judging nodes run what was written, say whose fault it is, audit, and keep to the fixes that are allowed."""

import json
from typing import Any

import pytest

from grs_agents.base import content
from grs_agents.base.trace.events import NodeEnded
from grs_agents.base.trace.log import read_events
from grs_agents.graph.judging import (
    audit_task,
    conclude_with_best_version,
    decide_what_to_fix,
    next_step_after_audit,
    next_step_after_tests,
    read_routing_verdict,
    run_tests,
)
from grs_agents.graph.services import Services
from grs_agents.graph.state import RunState
from tests.graph.conftest import SIMULATION, TASK, TESTS, Make, fenced, kinds, run, with_

RAISES = SIMULATION.replace("super().reset(env)", "raise RuntimeError('no such luck')")
OTHER_TASK = {**TASK, "assets-used": [*TASK["assets-used"], "block/green_block.urdf"]}
"""Names a block that the program leaves out, which the audit objects to and the tests don't."""
REPORT = {"outcome": "failed", "message": "", "backend": "process"}
CASE = {"id": "T.test_a", "outcome": "failed", "message": "1 != 2", "raised_in": "tests"}
FAILED = {**REPORT, "cases": [CASE]}
PASSED = {**REPORT, "outcome": "passed", "cases": [{"id": "T.test_a", "outcome": "passed"}]}


def audited(accepted: bool) -> dict[str, Any]:
    """An audit with one finding."""
    finding = {"check": "solved", "passed": accepted, "measured": "strict score 0.20", "bound": ""}
    return {"accepted": accepted, "findings": [finding], "changes": [], "rollouts": [], "rewards": []}


def test_a_program_that_keeps_its_tests_goes_to_the_audit(state: RunState, make_services: Make) -> None:
    services = make_services()
    update = run(run_tests, with_(state, audit=audited(False)), services)
    assert update["report"].outcome == "passed"
    assert not update["audit"]  # of the version before
    assert kinds(services, "tests_run")[0].report == update["report"].model_dump(mode="json")
    assert next_step_after_tests(with_(state, **update)) == "audit"


def test_a_program_that_raises_is_a_report_and_no_exception(state: RunState, make_services: Make) -> None:
    update = run(run_tests, with_(state, simulation=RAISES), make_services())
    assert (update["report"].outcome, update["report"].raised_in) == ("failed", "simulation")
    assert next_step_after_tests(with_(state, **update)) == "fix"


@pytest.mark.parametrize(("fixes", "allowed", "way"), [(0, 0, "stop"), (0, 1, "fix"), (1, 2, "fix"), (2, 2, "stop")])
def test_there_are_as_many_fixes_as_allowed(state: RunState, fixes: int, allowed: int, way: str) -> None:
    here = with_(state, fixes=fixes, max_fixes=allowed)
    assert next_step_after_tests(with_(here, report=FAILED)) == way
    assert next_step_after_audit(with_(here, report=PASSED, audit=audited(False))) == way
    assert next_step_after_tests(with_(here, report=PASSED)) == "audit"
    assert next_step_after_audit(with_(here, report=PASSED, audit=audited(True))) == "stop"


@pytest.mark.parametrize("verdict", ["fix_code", "fix_test"])
def test_the_router_model_decides_and_its_reason_is_kept(state: RunState, make_services: Make, verdict: str) -> None:
    services = make_services(f"One is not two.\n```\n{verdict}\n```")
    update = run(decide_what_to_fix, with_(state, report=FAILED), services)
    assert (update["decision"].verdict, update["decision"].explanation) == (verdict, "One is not two.")
    [decision] = kinds(services, "decision")
    assert (decision.verdict, decision.explanation) == (verdict, "One is not two.")
    assert read_routing_verdict(with_(state, **update)) == verdict
    [prompt] = kinds(services, "prompt")
    assert all(part in prompt.text for part in ("1 != 2", SIMULATION.strip(), TESTS.strip(), '"blue_block_1"'))


def test_where_the_router_model_is_of_no_use_rules_decide_and_say_so(state: RunState, make_services: Make) -> None:
    services = make_services("I cannot say.", "I cannot say.", reply_retries=1)
    update = run(decide_what_to_fix, with_(state, report=PASSED, audit=audited(False)), services)
    assert update["decision"].verdict == "fix_code"
    assert "rules" in update["decision"].policy
    assert "no usable reply" in update["decision"].explanation


def test_after_the_audit_the_router_reads_its_findings(state: RunState, make_services: Make) -> None:
    services = make_services("So be it.\n```\nfix_code\n```")
    run(decide_what_to_fix, with_(state, report=PASSED, audit=audited(False)), services)
    assert "strict score 0.20" in kinds(services, "prompt")[0].text


def test_the_audit_accepts_what_the_oracle_solves(state: RunState, make_services: Make) -> None:
    services = make_services()
    stale = services.folder / "instances" / "seed_7.json"
    stale.parent.mkdir()
    stale.write_text("{}")
    update = run(audit_task, state, services)
    assert update["audit"].accepted is True, update["audit"].findings
    assert json.loads((services.folder / "audit.json").read_text()) == update["audit"].model_dump(mode="json")
    assert sorted(file.name for file in stale.parent.iterdir()) == ["seed_0.json", "seed_0.npz"]
    assert [event.check for event in kinds(services, "finding")] == [
        finding.check for finding in update["audit"].findings
    ]
    assert [event.outcome for event in kinds(services, "rollout")] == ["success"]


@pytest.mark.parametrize(
    ("change", "check"),
    [({"task": OTHER_TASK}, "assets_of_task"), ({"simulation": RAISES}, "instantiated")],
    ids=["a block is left out", "the program raises"],
)
def test_the_audit_rejects_by_name(state: RunState, make_services: Make, change: Any, check: str) -> None:
    services = make_services()
    update = run(audit_task, with_(state, **change), services)
    assert update["audit"].accepted is False
    assert check in {event.check for event in kinds(services, "finding") if not event.passed}
    assert next_step_after_audit(with_(state, **update)) == "fix"


@pytest.mark.parametrize(
    ("changes", "status", "told"),
    [
        ({"problem": "the task model gave no usable reply"}, "rejected", ["the task model gave no usable reply"]),
        ({"report": PASSED, "audit": audited(True)}, "accepted", []),
        ({"report": PASSED, "audit": audited(False)}, "rejected", ["solved: strict score 0.20", "1 of 2"]),
        ({"report": FAILED}, "rejected", ["the robot meets every goal, yet test_a: 1 != 2", "1 of 2"]),
        ({"report": {**REPORT, "outcome": "error", "message": "it does not parse"}}, "rejected", ["does not parse"]),
    ],
)
def test_the_end_says_why(state: RunState, make_services: Make, changes: Any, status: str, told: list[str]) -> None:
    update = run(conclude_with_best_version, with_(state, fixes=1, **changes), make_services())
    assert update["status"] == status
    assert all(part in update["reason"] for part in told), update["reason"]


def test_an_exception_in_a_node_is_logged_and_goes_on(state: RunState, make_services: Make) -> None:
    services = make_services(RuntimeError("the model is no more"))
    with pytest.raises(Exception, match="the model is no more"):
        run(decide_what_to_fix, with_(state, report=FAILED), services)
    last = read_events(services.log.path)[-1]
    assert isinstance(last, NodeEnded) and "the model is no more" in last.error


def after_generation(state: RunState, services: Services) -> dict[str, Any]:
    """Run the router graph on a state without programs: the models write both, and every fix is one of the program."""
    begin = {key: state[key] for key in ("scene_path", "max_fixes", "fixes", "history", "image", "scene", "task")}
    graph = content.load_module("graphs", "router").build().compile()
    return graph.invoke(begin, {"recursion_limit": 60}, context=services)


@pytest.mark.parametrize("allowed", [0, 2])
def test_what_the_audit_never_accepts_is_fixed_as_often_as_allowed(
    state: RunState, make_services: Make, allowed: int
) -> None:
    fixes = [fenced(f"{SIMULATION}# fix {number}") for number in range(1, 6)]
    services = make_services(fenced(SIMULATION), fenced(TESTS), *fixes, policy="always_code", max_fixes=allowed)
    ended = after_generation(with_(state, task=OTHER_TASK, max_fixes=allowed), services)
    assert (ended["status"], ended["fixes"]) == ("rejected", allowed)
    ran = [event.node for event in kinds(services, "node_ended")]
    assert (ran.count("fix_code"), ran.count("audit")) == (allowed, allowed + 1)
    assert f"{allowed} of {allowed} fixes used" in ended["reason"]


def test_what_the_audit_rejects_is_fixed_and_then_accepted(state: RunState, make_services: Make) -> None:
    more = SIMULATION + '        env.add_object("block/green_block.urdf", ((0.55, 0.3, 0.02), flat), "fixed")\n'
    services = make_services(fenced(more), fenced(TESTS), fenced(SIMULATION), policy="always_code")
    ended = after_generation(state, services)
    assert (ended["status"], ended["fixes"]) == ("accepted", 1), ended["reason"]
    assert [event.node for event in kinds(services, "node_ended")] == [
        "generate_sim",
        "generate_tests",
        "run_tests",
        "audit",
        "route",
        "fix_code",
        "run_tests",
        "audit",
        "conclude",
    ]
    [fix] = [event for event in kinds(services, "prompt") if event.role == "fix_code"]
    assert "== audit" in fix.text and "assets_of_task" in fix.text
