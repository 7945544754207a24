"""The built-in routing policies, and how one's own is found."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any, TypedDict, cast

import pytest
from langgraph.checkpoint.memory import InMemorySaver
from langgraph.graph import START, StateGraph
from langgraph.types import Command

from grs_agents.agents.agent import Agents
from grs_agents.agents.types import TaskDefinition
from grs_agents.audit.types import AuditFinding, AuditReport, StaticFinding
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
from grs_agents.sim.rollouts import Rollout
from grs_agents.sim.world.bystanders import FIRST_BYSTANDER
from tests.scripted import scripted

TASK = TaskDefinition.model_validate({"task-name": "t", "task-description": "d", "assets-used": ["a"]})


def episode(outcome: Outcome, **facts: Any) -> dict[str, Any]:
    """The oracle's episode as a test reports it; it did something, and something stood there, unless told."""
    moved = ObjectMotion(object=1, asset="a", start=(0.5, 0, 0), end=(0.6, 0, 0), tilt=0, moved=True)
    action = ActionRecord(object=1, asset="a", pick=(0.5, 0, 0), place=(0.6, 0, 0), reward=1, note="placed")
    said = {"reward": 1.0, "strict": 1.0, "steps": 1, "max_steps": 4, "detail": "", "actions": (action,)}
    return Episode.model_validate({"outcome": outcome, "motions": (moved,), **said, **facts}).model_dump(mode="json")


def case(
    outcome: str, raised_in: str | None, episode: dict[str, Any] | None = None, message: str = "m", traceback: str = ""
) -> TestCase:
    told = {"message": message, "traceback": traceback}
    return TestCase.model_validate(
        {"id": "T.test_a", "outcome": outcome, "raised_in": raised_in, "episode": episode, **told}
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
    ("extent", "verdict"), [((0.22, 0.3), "fix_test"), ((0.3, 0.22), "fix_code"), ((0, 0), "fix_test")]
)
def test_a_box_that_stands_across_its_pose_in_the_photo_is_a_doubt(extent: tuple[float, float], verdict: str) -> None:
    moved = [
        motion.model_copy(update={"extent": extent}) if motion.asset == "container/open_box.urdf" else motion
        for motion in motions(RIGHT)
    ]
    given = context("failed", [case("failed", "tests", episode("success", motions=moved))])
    assert load_policy("rules").decide(replace(given, task=STACK, scene=SCENE)).verdict == verdict


def test_a_program_that_overrides_what_the_runtime_answers_is_to_be_fixed() -> None:
    given = context(
        "failed", [case("error", "tests", message="AttributeError: 'NoneType' object has no attribute 'act'")]
    )
    assert load_policy("rules").decide(given).verdict == "fix_test"
    own = "class Mine(Task):\n    def oracle(self, env):\n        return None\n"
    decision = load_policy("rules").decide(replace(given, simulation=own))
    assert (decision.verdict, decision.sure) == ("fix_code", False)


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


ZONE = "zone/zone-template.urdf"
SORT = TaskDefinition.model_validate(
    {
        "task-name": "sort",
        "task-description": "Put the red cube on the green zone, and the blue cube on the yellow zone.",
        "assets-used": ["block/red_block.urdf", "block/blue_block.urdf", ZONE],
    }
)


def sorted_cubes(red: Vec3, blue: Vec3) -> tuple[ObjectMotion, ...]:
    """Both cubes at their ends; the green zone is 12 cm from the yellow one."""
    ends = {"block/red_block.urdf": red, "block/blue_block.urdf": blue}
    cubes = [
        ObjectMotion(object=number, asset=name, start=STARTS[name], end=end, tilt=0, moved=True, extent=(0.04, 0.04))
        for number, (name, end) in enumerate(ends.items())
    ]
    zones = [
        ObjectMotion(object=number, asset=ZONE, start=at, end=at, tilt=0, moved=False, extent=(0.1, 0.1), color=color)
        for number, at, color in ((5, ON_GREEN, "green"), (6, ON_YELLOW, "yellow"))
    ]
    return (*cubes, *zones)


ON_GREEN, ON_YELLOW = (0.45, 0.0, 0.001), (0.45, 0.12, 0.001)


@pytest.mark.parametrize(
    ("red", "blue", "words", "verdict", "sure"),
    [
        (ON_GREEN, ON_YELLOW, "", "fix_test", True),
        (ON_YELLOW, ON_GREEN, "", "fix_code", True),
        (ON_GREEN, ON_GREEN, "", "fix_code", True),
        (ON_GREEN, ON_YELLOW, " Turn it so that the label shows.", "fix_test", False),
        (ON_GREEN, ON_YELLOW, " Then sing.", "fix_test", False),
        (ON_YELLOW, ON_GREEN, " Then sing.", "fix_code", False),
    ],
    ids=["right", "crossed", "both-on-one", "more-asked-for", "more-clauses", "crossed-and-more"],
)
def test_colours_tell_two_zones_of_an_asset_apart(red: Vec3, blue: Vec3, words: str, verdict: str, sure: bool) -> None:
    task = SORT.model_copy(update={"description": SORT.description + words})
    given = context("failed", [case("failed", "tests", episode("success", motions=sorted_cubes(red, blue)))])
    scene = json.loads(SCENE)
    scene["objects"] = [item for item in scene["objects"] if item["asset"] in SORT.assets]
    decision = load_policy("rules").decide(replace(given, task=task, scene=json.dumps(scene)))
    assert (decision.verdict, decision.sure) == (verdict, sure), decision.explanation


def test_a_zone_of_another_colour_and_a_wrong_order_in_time_are_doubts_about_the_program() -> None:
    pink = [
        motion.model_copy(update={"color": "pink"}) if motion.asset == ZONE else motion
        for motion in sorted_cubes(ON_GREEN, ON_YELLOW)
    ]
    given = context("failed", [case("failed", "tests", episode("success", motions=pink))])
    decision = load_policy("rules").decide(replace(given, task=SORT))
    assert (decision.verdict, decision.sure) == ("fix_code", False) and "pink" in decision.explanation
    moves = [
        ActionRecord(object=1, asset=name, pick=(0, 0, 0), place=(0, 0, 0), reward=0.5, note="placed")
        for name in ("block/blue_block.urdf", "block/red_block.urdf")
    ]
    then = SORT.model_copy(update={"description": SORT.description.replace(", and", ", then put")})
    for actions, verdict in ((moves, "fix_code"), (moves[::-1], "fix_test")):
        facts = {"motions": sorted_cubes(ON_GREEN, ON_YELLOW), "actions": actions}
        given = context("failed", [case("failed", "tests", episode("success", **facts))])
        assert load_policy("rules").decide(replace(given, task=then)).verdict == verdict


@pytest.mark.parametrize(
    ("description", "ends", "verdict"),
    [
        ("Line up {} on the zone, side by side from the shortest to the tallest.", (0.1, 0.2, 0.3), "fix_test"),
        ("Line up {} on the zone, side by side from the shortest to the tallest.", (0.3, 0.2, 0.1), "fix_test"),
        ("Line up {} on the zone, side by side from the shortest to the tallest.", (0.1, 0.3, 0.2), "fix_code"),
        ("Put {} in front of the zone.", (0.1, 0.3, 0.2), "fix_test"),
    ],
)
def test_a_row_has_the_order_of_heights(description: str, ends: tuple[float, ...], verdict: str) -> None:
    names = ("block/blue_block.urdf", "HOPE/Tuna.urdf", "container/open_box.urdf")
    heights = (0.04, 0.06, 0.09)
    things = [
        {"name": name, "asset": name, "position": [0.5, -0.3, 0.02], "size": [0.04, 0.04, height]}
        for name, height in zip(names, heights, strict=True)
    ]
    text = description.format("the blue block, the tuna and the open box")
    task = {"task-name": "t", "task-description": text, "assets-used": [*names, ZONE]}
    moved = [
        ObjectMotion(object=number, asset=name, start=(0.5, -0.3, 0.02), end=(0.5, y, 0.02), tilt=0, moved=True)
        for number, (name, y) in enumerate(zip(names, ends, strict=True))
    ]
    zone = ObjectMotion(object=9, asset=ZONE, start=(0.5, 0.2, 0), end=(0.5, 0.2, 0), tilt=0, moved=False)
    given = context("failed", [case("failed", "tests", episode("success", motions=(*moved, zone)))])
    scene = json.dumps({"objects": things})
    given = replace(given, task=TaskDefinition.model_validate(task), scene=scene)
    assert load_policy("rules").decide(given).verdict == verdict


LOST = ActionRecord(
    object=1,
    asset="HOPE/Tuna.urdf",
    pick=(0.62, -0.24, 0.03),
    place=(0.6, 0.2, 0.03),
    reward=0,
    note="HOPE/Tuna.urdf (0.98 kg) tipped off the cup: 0.27 N m bent it, it bears 0.15 N m",
)
SLIPPED = LOST.model_copy(
    update={"note": "HOPE/Tuna.urdf (2.5 kg) slipped from between the fingers, which press with 40 N"}
)


@pytest.mark.parametrize(
    ("outcome", "facts", "start", "verdict"),
    [
        ("dropped", {"actions": (LOST,)}, STARTS["HOPE/Tuna.urdf"], "fix_task"),
        ("step_limit", {"actions": (LOST,)}, STARTS["HOPE/Tuna.urdf"], "fix_task"),
        ("no_seal", {"objects": ("HOPE/Tuna.urdf",)}, STARTS["HOPE/Tuna.urdf"], "fix_task"),
        ("no_grip", {"objects": ("HOPE/Tuna.urdf",)}, STARTS["HOPE/Tuna.urdf"], "fix_task"),
        ("dropped", {"actions": (SLIPPED,)}, STARTS["HOPE/Tuna.urdf"], "fix_task"),
        ("unreachable", {"objects": ("HOPE/Tuna.urdf",)}, STARTS["HOPE/Tuna.urdf"], "fix_code"),
        ("dropped", {"actions": (LOST,)}, (0.55, -0.24, 0.017), "fix_code"),
        ("no_seal", {"objects": ("HOPE/Tuna.urdf",)}, (0.62, -0.24, 0.037), "fix_code"),
        ("dropped", {"actions": (LOST.model_copy(update={"note": f"{LOST.note} as it hit a"}),)}, None, "fix_code"),
    ],
)
def test_what_the_arm_cannot_hold_where_the_photo_shows_it_is_the_tasks(
    outcome: Outcome, facts: dict[str, Any], start: Vec3 | None, verdict: str
) -> None:
    starts = {"HOPE/Tuna.urdf": start or STARTS["HOPE/Tuna.urdf"]}
    failed = case("failed", "tests", episode(outcome, motions=motions({}, starts), detail="no seal", **facts))
    given = replace(context("failed", [failed]), task=STACK, scene=SCENE)
    revisable = replace(given, verdicts=("fix_code", "fix_test", "fix_task"))
    decision = load_policy("rules").decide(revisable)
    assert (decision.verdict, decision.cause == "wrong_task") == (verdict, verdict == "fix_task")
    assert load_policy("rules").decide(given).verdict == "fix_code"


def test_what_is_out_of_reach_in_the_photo_is_the_tasks() -> None:
    far = SCENE.replace('"name": "tuna_1"', '"reachable": false, "name": "tuna_1"')
    facts = {"motions": motions({}), "objects": ("HOPE/Tuna.urdf",), "detail": "1.03 m from the base"}
    given = context("failed", [case("failed", "tests", episode("unreachable", **facts))])
    given = replace(given, task=STACK, scene=far, verdicts=("fix_code", "fix_test", "fix_task"))
    assert load_policy("rules").decide(given).verdict == "fix_task"


@pytest.mark.parametrize(
    ("measured", "verdicts", "verdict"),
    [
        ("not_judged, says m: which cube?", ("fix_task",), "fix_task"),
        ("the judge model gave no usable reply in 3 tries: no JSON", ("fix_task",), "fix_task"),
        ("differ, says m: the can stays", ("fix_code", "fix_task"), "fix_code"),
    ],
)
def test_unclear_words_are_the_tasks(measured: str, verdicts: tuple[Any, ...], verdict: str) -> None:
    finding = AuditFinding(check="words", passed=False, measured=measured, bound="")
    audit = AuditReport(accepted=False, findings=(finding,), changes=(), rollouts=(), rewards=())
    given = context("passed", [case("passed", None)], audit_failed=True)
    decision = load_policy("rules").decide(replace(given, audit=audit, verdicts=verdicts))
    assert decision.verdict == verdict


def failed_audit(*checks: str, rollouts: tuple[Rollout, ...] = ()) -> AuditReport:
    findings = tuple(AuditFinding(check=name, passed=False, measured="1", bound="2") for name in checks)
    return AuditReport(accepted=False, findings=findings, changes=(), rollouts=rollouts, rewards=())


@pytest.mark.parametrize(("checks", "verdict"), [(("moved",), "fix_task"), (("moved", "moves_far"), "fix_code")])
def test_a_right_program_of_words_that_move_too_little_leaves_the_task_at_fault(
    checks: tuple[str, ...], verdict: str
) -> None:
    given = context("passed", [case("passed", None)], audit_failed=True)
    given = replace(given, audit=failed_audit(*checks), verdicts=("fix_code", "fix_test", "fix_task"))
    assert load_policy("rules").decide(given).verdict == verdict


@pytest.mark.parametrize(
    ("neighbour", "verdict"),
    [((0.62, -0.30, 0.02), "fix_task"), ((0.45, 0.30, 0.02), "fix_code")],
    ids=["beside the pick in the photo", "beside a target of the program"],
)
def test_a_neighbour_that_the_arm_knocks_where_the_photo_shows_the_object_is_the_tasks(
    neighbour: Vec3, verdict: str
) -> None:
    knocked = ObjectMotion(
        object=FIRST_BYSTANDER, asset="HOPE/Milk.urdf", start=neighbour, end=(0.7, 0.1, 0), tilt=0, moved=True
    )
    action = LOST.model_copy(update={"note": "placed", "place": (0.45, 0.24, 0.03)})
    played = Episode.model_validate(episode("success", motions=(*motions({}), knocked), actions=(action,)))
    rollout = Rollout(seed=3, episode=played, idle_reward=0, moved=(), initial={}, final={}, reachable=())
    given = context("passed", [case("passed", None)], audit_failed=True)
    given = replace(given, audit=failed_audit("undisturbed", rollouts=(rollout,)), task=STACK, scene=SCENE)
    decision = load_policy("rules").decide(replace(given, verdicts=("fix_code", "fix_test", "fix_task")))
    assert decision.verdict == verdict
    assert verdict == "fix_code" or ("seed 3" in decision.explanation and "HOPE/Milk.urdf" in decision.explanation)


SWAPPED_TOWER = {"HOPE/Tuna.urdf": 0.017, "block/red_block.urdf": 0.053, "block/blue_block.urdf": 0.093}


@pytest.mark.parametrize(
    ("description", "ends", "verdict"),
    [
        (
            "Build a tower with the tuna as its base, the blue cube in the middle and the red cube at the very top.",
            dict.fromkeys(SWAPPED_TOWER, (0.62, -0.24)),
            "fix_code",
        ),
        (
            "Build a tower with the tuna as its base, the red cube in the middle and the blue cube at the very top.",
            dict.fromkeys(SWAPPED_TOWER, (0.62, -0.24)),
            "fix_test",
        ),
        ("Clear the left side by placing both cubes on the tuna.", {"block/red_block.urdf": (0.3, 0.3)}, "fix_code"),
        (
            "Set the red cube apart from the others by moving it onto the tuna.",
            {"block/red_block.urdf": (0.3, 0.3)},
            "fix_code",
        ),
        ("Tidy up, so that the red cube is on the tuna.", {"block/red_block.urdf": (0.3, 0.3)}, "fix_code"),
        ("Put everything except the red cube on the tuna.", {"block/blue_block.urdf": (0.3, 0.3)}, "fix_code"),
        ("Put everything except the red cube on the tuna.", {"block/red_block.urdf": (0.3, 0.3)}, "fix_test"),
        ("Put all cubes except the red cube on the tuna.", {"block/red_block.urdf": (0.3, 0.3)}, "fix_test"),
    ],
)
def test_natural_words_tell_a_wrong_program_from_a_wrong_expectation(
    description: str, ends: dict[str, tuple[float, float]], verdict: str
) -> None:
    task = STACK.model_copy(update={"description": description, "assets": tuple(SWAPPED_TOWER)})
    moved = tuple(
        ObjectMotion(
            object=number,
            asset=name,
            start=STARTS[name],
            end=(*ends.get(name, (0.62, -0.24)), height),
            tilt=0,
            moved="block" in name,
            extent=(0.07, 0.07),
        )
        for number, (name, height) in enumerate(SWAPPED_TOWER.items(), 1)
    )
    given = context("failed", [case("failed", "tests", episode("success", motions=moved))])
    scene = json.loads(SCENE)
    scene["objects"] = [item for item in scene["objects"] if item["asset"] in SWAPPED_TOWER]
    decision = load_policy("rules").decide(replace(given, task=task, scene=json.dumps(scene)))
    assert (decision.verdict, decision.sure) == (verdict, False), decision.explanation


@pytest.mark.parametrize(
    ("description", "ends", "verdict"),
    [
        (
            "Put the red cube to the left of the tuna and the blue cube in front of it.",
            ((0.62, 0), (0.5, -0.2)),
            "fix_test",
        ),
        (
            "Put the red cube to the right of the tuna and the blue cube in front of it.",
            ((0.62, 0), (0.5, -0.2)),
            "fix_code",
        ),
        ("Put the red cube to the left of the tuna and the blue cube behind it.", ((0.62, 0), (0.5, -0.2)), "fix_code"),
        ("In the photo, put the red cube to the right of the tuna.", ((0.62, 0), (0.5, -0.2)), "fix_test"),
        ("Stand all in a row, the tallest on the left.", ((0.6, -0.3), (0.6, -0.4)), "fix_code"),
        ("Stand all in a row, the tallest on the right.", ((0.6, -0.3), (0.6, -0.4)), "fix_test"),
        ("Arrange an evenly spaced row, the tallest on the right.", ((0.6, -0.3), (0.6, -0.45)), "fix_code"),
    ],
)
def test_sides_and_rows_are_as_the_robot_sees_them(
    description: str, ends: tuple[tuple[float, float], tuple[float, float]], verdict: str
) -> None:
    task = STACK.model_copy(update={"description": description, "assets": tuple(SWAPPED_TOWER)})
    places = {
        "HOPE/Tuna.urdf": (0.62, -0.24),
        **dict(zip(("block/red_block.urdf", "block/blue_block.urdf"), ends, strict=True)),
    }
    moved = tuple(
        ObjectMotion(object=number, asset=name, start=STARTS[name], end=(*place, 0.02), tilt=0, moved="block" in name)
        for number, (name, place) in enumerate(places.items(), 1)
    )
    sizes = {"HOPE/Tuna.urdf": 0.033, "block/red_block.urdf": 0.04, "block/blue_block.urdf": 0.05}
    items = [item for item in json.loads(SCENE)["objects"] if item["asset"] in sizes]
    scene = json.dumps({"objects": [{**item, "size": [0.07, 0.07, sizes[item["asset"]]]} for item in items]})
    given = context("failed", [case("failed", "tests", episode("success", motions=moved))])
    decision = load_policy("rules").decide(replace(given, task=task, scene=scene))
    assert (decision.verdict, decision.sure) == (verdict, False), decision.explanation


CALLS_RESET = """Traceback (most recent call last):
  File "test_task_code.py", line 12, in setUp
    self.task.reset(None)
  File "task_code.py", line 17, in reset
    env.add_object("HOPE/Tuna.urdf", pose)
AttributeError: 'NoneType' object has no attribute 'add_object'"""


@pytest.mark.parametrize(
    ("failed", "tests", "verdict", "sure"),
    [
        (case("error", "tests", message="ValueError: too many values to unpack"), "", "fix_test", False),
        (
            case("error", "tests", message="AttributeError: 'NoneType' object has no attribute 'x'"),
            "",
            "fix_test",
            False,
        ),
        (case("error", "tests", message="AttributeError: 'Oracle' object has no attribute 'x'"), "", "fix_test", True),
        (case("error", "simulation", message="ValueError: no"), "", "fix_code", True),
        (
            case("error", "simulation", message=CALLS_RESET.splitlines()[-1], traceback=CALLS_RESET),
            "",
            "fix_test",
            False,
        ),
        (case("error", "simulation", message="ValueError: no", traceback=CALLS_RESET), "", "fix_code", False),
        (case("failed", "tests", episode("unreachable")), "Environment(robot='panda')", "fix_test", False),
        (case("failed", "tests", episode("unreachable")), "Environment('assets', disp=False)", "fix_code", True),
        (case("failed", "tests", episode("partial")), "env.step({'pose0': a, 'pose1': b})", "fix_test", False),
        (case("timeout", "library"), "", "fix_code", False),
    ],
)
def test_rules_are_sure_only_where_the_other_program_cannot_be_the_cause(
    failed: TestCase, tests: str, verdict: str, sure: bool
) -> None:
    decision = load_policy("rules").decide(replace(context("failed", [failed]), tests=tests))
    assert (decision.verdict, decision.sure) == (verdict, sure), decision.explanation


SURE, UNSURE = case("error", "tests", message="NameError: name 'np' is not defined"), case("failed", "tests")


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
