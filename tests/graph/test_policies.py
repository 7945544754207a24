"""The built-in routing policies, and how one's own is found."""

from dataclasses import replace
from pathlib import Path
from typing import Any, TypedDict, cast

import pytest
from langgraph.checkpoint.memory import InMemorySaver
from langgraph.graph import START, StateGraph
from langgraph.types import Command

from grs_agents.agents.agent import Agents
from grs_agents.agents.types import TaskDefinition
from grs_agents.audit.types import StaticFinding
from grs_agents.base import Vec3
from grs_agents.base.config.schema import Config
from grs_agents.base.errors import ConfigError, UnknownNameError
from grs_agents.base.questions import parse_question
from grs_agents.base.trace.events import Prompt
from grs_agents.base.trace.log import read_events
from grs_agents.graph.evidence import render_evidence
from grs_agents.graph.policies.policy_registry import POLICIES, load_policy
from grs_agents.graph.policies.types import EarlierDecision, RoutingContext, RoutingDecision, list_stable_failures
from grs_agents.sandbox.protocol.report import TestCase, TestReport
from grs_agents.sim import ActionRecord, Episode, Outcome
from grs_agents.sim.instance.episode import ObjectMotion
from tests.scripted import scripted

TASK = TaskDefinition.model_validate({"task-name": "t", "task-description": "d", "assets-used": ["a"]})


def episode(outcome: Outcome, **facts: Any) -> dict[str, Any]:
    """The oracle's episode as a test reports it; it did something, and something stood there, unless told."""
    moved = ObjectMotion(object=1, asset="a", start=(0.5, 0, 0), end=(0.6, 0, 0), tilt=0, moved=True)
    action = ActionRecord(object=1, asset="a", pick=(0.5, 0, 0), place=(0.6, 0, 0), reward=1, note="placed")
    said = {"reward": 1.0, "strict": 1.0, "steps": 1, "max_steps": 4, "detail": "", "actions": (action,)}
    return Episode.model_validate({"outcome": outcome, "motions": (moved,), **said, **facts}).model_dump(mode="json")


def case(outcome: str, raised_in: str | None, episode: dict[str, Any] | None = None) -> TestCase:
    return TestCase.model_validate(
        {"id": "T.test_a", "outcome": outcome, "message": "m", "raised_in": raised_in, "episode": episode}
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
        (context("failed", [case("failed", "tests", episode("step_limit"))]), "fix_code"),
        (context("failed", [case("failed", "tests", episode("success"))]), "fix_test"),
        (context("failed", [case("failed", "tests", episode("partial"))]), "fix_code"),
        (context("failed", [case("failed", "tests", episode("stopped"))]), "fix_test"),
        (context("failed", [case("error", "tests", episode("stopped"))]), "fix_test"),
        (context("failed", [case("error", "tests"), case("error", "simulation")]), "fix_code"),
        (context("failed", [case("no_assertion", None)]), "fix_test"),
        (context("failed", [case("expected_failure", "tests", episode("partial"))]), "fix_test"),
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


STACK = TaskDefinition.model_validate(
    {
        "task-name": "stack",
        "task-description": "Put the tuna can into the box, then stack the red cube on the blue cube.",
        "assets-used": ["HOPE/Tuna.urdf", "container/open_box.urdf", "block/red_block.urdf", "block/blue_block.urdf"],
    }
)
SCENE = """{"objects": [
{"name": "open_box_1", "asset": "container/open_box.urdf", "category": "box", "color": "brown",
 "position": [0.58, 0.23, 0.045], "size": [0.22, 0.3, 0.09]},
{"name": "tuna_1", "asset": "HOPE/Tuna.urdf", "category": "can", "color": "white",
 "position": [0.62, -0.24, 0.017], "size": [0.07, 0.07, 0.03]},
{"name": "red_block_1", "asset": "block/red_block.urdf", "category": "cube", "color": "red",
 "position": [0.66, -0.34, 0.02], "size": [0.04, 0.04, 0.04]},
{"name": "blue_block_1", "asset": "block/blue_block.urdf", "category": "cube", "color": "blue",
 "position": [0.57, -0.34, 0.02], "size": [0.04, 0.04, 0.04]}]}"""
STARTS = {
    "container/open_box.urdf": (0.58, 0.23, 0.045),
    "HOPE/Tuna.urdf": (0.62, -0.24, 0.017),
    "block/red_block.urdf": (0.66, -0.34, 0.02),
    "block/blue_block.urdf": (0.57, -0.34, 0.02),
}
IN_BOX, ON_BLUE, ON_RED = (0.6, 0.2, 0.03), (0.57, -0.34, 0.06), (0.66, -0.34, 0.06)


def motions(ends: dict[str, Vec3], starts: dict[str, Vec3] | None = None) -> tuple[ObjectMotion, ...]:
    """The four things of the scene, those of ``ends`` moved there."""
    begin = {**STARTS, **(starts or {})}
    return tuple(
        ObjectMotion(
            object=number, asset=name, start=begin[name], end=ends.get(name, begin[name]), tilt=0, moved=name in ends
        )
        for number, name in enumerate(begin)
    )


RIGHT = {"HOPE/Tuna.urdf": IN_BOX, "block/red_block.urdf": ON_BLUE}


@pytest.mark.parametrize(
    ("facts", "verdict", "sure"),
    [
        ({"motions": motions(RIGHT)}, "fix_test", True),
        ({"motions": motions({"block/red_block.urdf": ON_BLUE})}, "fix_code", True),
        ({"motions": motions({"HOPE/Tuna.urdf": IN_BOX, "block/blue_block.urdf": ON_RED})}, "fix_code", True),
        ({"motions": motions({**RIGHT, "HOPE/Tuna.urdf": (0.4, 0.23, 0.017)})}, "fix_code", True),
        ({"motions": motions(RIGHT), "strict": 0.5}, "fix_code", True),
        ({"motions": motions(RIGHT, {"block/blue_block.urdf": (0.54, -0.34, 0.02)})}, "fix_code", False),
        ({"motions": motions(RIGHT), "actions": (), "steps": 0}, "fix_code", False),
    ],
    ids=["all-done", "not-moved", "other-way-round", "beside-the-box", "loosely", "not-as-in-photo", "solved-at-start"],
)
def test_a_solved_episode_clears_the_program_only_if_it_did_the_task(
    facts: dict[str, Any], verdict: str, sure: bool
) -> None:
    given = context("failed", [case("failed", "tests", episode("success", **facts))])
    decision = load_policy("rules").decide(replace(given, task=STACK, scene=SCENE))
    assert (decision.verdict, decision.sure) == (verdict, sure), decision.explanation


@pytest.mark.parametrize(
    ("program", "kind", "verdict"),
    [
        ("simulation", "unknown_asset", "fix_code"),
        ("simulation", "object_without_goal", "fix_code"),
        ("tests", "class_missing", "fix_test"),
        ("simulation", "reward_sum", "fix_code"),
    ],
)
def test_static_findings_tell_right_tests_from_wrong_ones(program: Any, kind: Any, verdict: str) -> None:
    given = context("failed", [case("failed", "tests", episode("success"))])
    finding = StaticFinding(program=program, line=1, kind=kind, message="said so")
    assert load_policy("rules").decide(given).verdict == "fix_test"
    decision = load_policy("rules").decide(replace(given, static=(finding,)))
    assert (decision.verdict, "said so" in decision.explanation) == (verdict, True)


def test_tests_that_change_what_they_test_are_to_be_fixed() -> None:
    given = context("failed", [case("failed", "tests", episode("step_limit"))])
    assert load_policy("rules").decide(given).verdict == "fix_code"
    meddling = replace(given, tests="def test(self):\n    self.task.max_steps = 1\n")
    assert load_policy("rules").decide(meddling).verdict == "fix_test"


def test_a_task_that_cannot_be_done_is_revised_once_the_program_was_mended_in_vain() -> None:
    given = context("failed", [case("failed", "tests", episode("target_too_small"))])
    given = replace(given, verdicts=("fix_code", "fix_test", "fix_task"))
    assert load_policy("rules").decide(given).verdict == "fix_code"
    routed = EarlierDecision(failures=list_stable_failures(given.report), verdict="fix_code")
    assert load_policy("rules").decide(replace(given, earlier=(routed,))).verdict == "fix_task"


SURE, UNSURE = case("error", "tests"), case("failed", "tests")


@pytest.mark.parametrize(
    ("policy", "failed", "replies", "verdict", "by"),
    [
        ("hybrid", SURE, (), "fix_test", "hybrid (rules)"),
        ("hybrid", UNSURE, ("fix_code",), "fix_code", "hybrid"),
        ("hybrid", UNSURE, ("I cannot say.",), "fix_test", "hybrid (rules)"),
        ("vote", SURE, ("fix_code", "fix_code"), "fix_code", "vote"),
        ("vote", SURE, ("fix_code", "fix_test"), "fix_test", "vote (rules)"),
        ("vote", SURE, ("fix_code", "I cannot say."), "fix_test", "vote (rules)"),
        ("llm", SURE, ("fix_code",), "fix_code", "llm"),
        ("llm", SURE, ("I cannot say.",), "fix_test", "llm (rules)"),
    ],
)
def test_policies_that_ask_a_model(
    policy: str, failed: TestCase, replies: tuple[str, ...], verdict: str, by: str, tmp_path: Path
) -> None:
    texts = [f"Because.\n```\n{reply}\n```" for reply in replies]
    agents = scripted(tmp_path, texts, Config(reply_retries=0))
    decision = load_policy(policy).decide(replace(context("failed", [failed]), agents=agents))
    agents.log.close()
    prompts = [event.text for event in read_events(tmp_path / "events.jsonl") if isinstance(event, Prompt)]
    assert (decision.verdict, decision.policy, len(prompts)) == (verdict, by, len(replies))
    if policy == "vote":
        assert [text.rindex("fix_code:") < text.rindex("fix_test:") for text in prompts] == [True, False]


def test_rules_turn_to_the_other_side_while_the_report_stays_as_it_is() -> None:
    given = context("failed", [case("error", "tests")])
    verdicts: list[str] = []
    for _ in range(4):
        decision = load_policy("rules").decide(given)
        verdicts.append(decision.verdict)
        routed = EarlierDecision(failures=list_stable_failures(given.report), verdict=decision.verdict)
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


def test_human_asks_with_the_evidence_and_follows_the_reply() -> None:
    class Routing(TypedDict, total=False):
        verdict: str
        explanation: str

    def route(state: Routing) -> Routing:
        decision = load_policy("human").decide(context("failed", [case("error", "simulation")]))
        return {"verdict": decision.verdict, "explanation": decision.explanation}

    graph = StateGraph(Routing).add_node("route", route).add_edge(START, "route").compile(InMemorySaver())
    thread: Any = {"configurable": {"thread_id": "1"}}
    graph.invoke({}, thread)
    question = parse_question(graph.get_state(thread).interrupts[0].value)
    assert question.choices == ("fix_code", "fix_test")
    assert "The rules would say fix_code" in question.details
    assert graph.invoke(Command(resume="fix_test: the test expects what the task does not say"), thread) == {
        "verdict": "fix_test",
        "explanation": "the test expects what the task does not say",
    }
