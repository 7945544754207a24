"""The built-in routing policies, and how one's own is found."""

from dataclasses import replace
from typing import Any, cast

import pytest

from grs_agents.agents import Agents, TaskDefinition
from grs_agents.errors import ConfigError, UnknownNameError
from grs_agents.nodes import render_evidence
from grs_agents.policies import (
    POLICIES,
    Routed,
    RoutingContext,
    RoutingDecision,
    failures_without_run_details,
    load_policy,
)
from grs_agents.sandbox import TestCase, TestReport

TASK = TaskDefinition.model_validate({"task-name": "t", "task-description": "d", "assets-used": ["a"]})


def case(outcome: str, raised_in: str | None, episode: dict[str, Any] | None = None) -> TestCase:
    return TestCase.model_validate(
        {
            "id": "T.test_a",
            "outcome": outcome,
            "seconds": 0.1,
            "message": "m",
            "traceback": "t",
            "output": "",
            "raised_in": raised_in,
            "episode": episode,
        }
    )


def context(
    outcome: str, cases: list[TestCase], raised_in: str | None = None, audit_failed: bool = False
) -> RoutingContext:
    report = TestReport.model_validate(
        {
            "outcome": outcome,
            "cases": cases,
            "message": "m",
            "raised_in": raised_in,
            "seconds": 1.0,
            "backend": "process",
        }
    )
    return RoutingContext(
        TASK, report, render_evidence(report), audit_failed, (), cast(Agents, None)
    )  # rules ask no model


@pytest.mark.parametrize(
    ("given", "verdict"),
    [
        (context("failed", [case("error", "simulation")]), "fix_code"),
        (context("failed", [case("error", "tests")]), "fix_test"),
        (context("failed", [case("failed", "tests", {"outcome": "step_limit", "reward": 0.5})]), "fix_code"),
        (context("failed", [case("failed", "tests", {"outcome": "success", "reward": 1.0})]), "fix_test"),
        (context("failed", [case("failed", "tests", {"outcome": "partial", "reward": 0.5})]), "fix_code"),
        (context("failed", [case("failed", "tests", {"outcome": "stopped", "reward": 0.0})]), "fix_test"),
        (context("failed", [case("error", "tests", {"outcome": "stopped", "reward": 0.0})]), "fix_test"),
        (context("failed", [case("error", "tests"), case("error", "simulation")]), "fix_code"),
        (context("failed", [case("no_assertion", None)]), "fix_test"),
        (context("failed", [case("expected_failure", "tests", {"outcome": "partial", "reward": 0.5})]), "fix_test"),
        (context("tampered", [case("tampered", "tests")]), "fix_test"),
        (context("tampered", [case("tampered", "simulation")]), "fix_code"),
        (context("failed", [case("missing", "tests")]), "fix_test"),
        (context("failed", [case("limit", "simulation")]), "fix_code"),
        (context("failed", [case("timeout", "simulation")]), "fix_code"),
        (context("load_tests", []), "fix_test"),
        (context("error", [], "tests"), "fix_test"),
        (context("error", [], "simulation"), "fix_code"),
        (context("no_tests", []), "fix_test"),
        (context("passed", [case("passed", None)], audit_failed=True), "fix_code"),
    ],
)
def test_rules_judge_by_where_the_error_was_raised(given: RoutingContext, verdict: str) -> None:
    decision = load_policy("rules").decide(given)
    assert (decision.verdict, decision.policy) == (verdict, "rules")
    assert decision.explanation


def test_rules_turn_to_the_other_side_while_the_report_stays_as_it_is() -> None:
    given = context("failed", [case("error", "tests")])
    verdicts: list[str] = []
    for _ in range(4):
        decision = load_policy("rules").decide(given)
        verdicts.append(decision.verdict)
        routed = Routed(failures=failures_without_run_details(given.report), verdict=decision.verdict)
        given = replace(given, earlier=(*given.earlier, routed))
    assert verdicts == ["fix_test", "fix_code", "fix_test", "fix_code"]
    other = context("failed", [case("error", "simulation")])
    assert load_policy("rules").decide(replace(other, earlier=given.earlier)).verdict == "fix_code"


def test_always_code_never_blames_the_tests() -> None:
    given = context("failed", [case("error", "tests")])
    assert load_policy("always_code").decide(given).verdict == "fix_code"


class Own:
    def decide(self, context: RoutingContext) -> RoutingDecision:
        return RoutingDecision(verdict="fix_test", explanation="why not", policy="own")


class NoPolicy:
    pass


class Needy:
    def __init__(self) -> None:
        raise RuntimeError("no such luck")


def test_a_dotted_path_adds_ones_own() -> None:
    assert type(load_policy(f"{__name__}:Own")).__name__ == "Own"


@pytest.mark.parametrize("name", ["nowhere:Policy", f"{__name__}:Absent", f"{__name__}:NoPolicy", f"{__name__}:Needy"])
def test_a_path_that_is_no_policy_is_refused(name: str) -> None:
    with pytest.raises(ConfigError):
        load_policy(name)


def test_an_unknown_name_lists_the_valid_ones() -> None:
    with pytest.raises(UnknownNameError) as caught:
        load_policy("rule")
    assert set(POLICIES) <= set(caught.value.valid)
    assert str(caught.value).index("rules") < str(caught.value).index("llm")
