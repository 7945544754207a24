"""The evidence: each fact once, failures first, assertions told from errors, nothing of the machine."""

from typing import Any

from grs_agents.audit.types import AuditFinding, AuditReport, StaticFinding
from grs_agents.graph.evidence import render_evidence
from grs_agents.sandbox.protocol.report import TestCase, TestReport
from grs_agents.sim import Episode, Outcome, Rollout
from grs_agents.sim.instance.episode import GoalOutcome, ObjectMotion

EPISODE: dict[str, Any] = {
    "outcome": "step_limit",
    "reward": 0.5,
    "strict": 0.25,
    "steps": 1,
    "max_steps": 1,
    "detail": "1 of 2 objects at their goals",
    "goals": [
        {
            "goal": "inside HOPE/Milk.urdf #2 in box/box.urdf #1",
            "worth": 0.5,
            "published": 1.0,
            "strict": 0.5,
            "shortfalls": ["HOPE/Milk.urdf #2 is not below the rim"],
        }
    ],
    "actions": [
        {
            "object": 2,
            "asset": "HOPE/Milk.urdf",
            "pick": (0.3, 0, 0.1),
            "place": (0.5, 0, 0.1),
            "reward": 0.5,
            "note": "placed",
        }
    ],
    "motions": [
        {
            "object": 1,
            "asset": "box/box.urdf",
            "start": (0.5, 0, 0),
            "end": (0.5, 0, 0),
            "tilt": 0.0,
            "moved": False,
        },
        {
            "object": 2,
            "asset": "HOPE/Milk.urdf",
            "start": (0.3, 0, 0.1),
            "end": (0.5, 0, 0.2),
            "tilt": 90.0,
            "moved": True,
        },
    ],
    "warnings": ["add_goal has no argument symmetry; it was ignored"],
}
TRACE = """Traceback (most recent call last):
  File "test_task_code.py", line 12, in setUp
    self.env.reset()
  File "/opt/grs_agents/sim/cliport/environment.py", line 99, in reset
    self.task.reset(self)
    ~~~~~^^^^
  File "task_code.py", line 7, in reset
    raise ValueError("no")
ValueError: no"""
ASSERTED = """Traceback (most recent call last):
  File "test_task_code.py", line 30, in test_places
    self.assertEqual(1, 2)
AssertionError: 1 != 2 : red is at 1"""


def case(name: str, outcome: Any = "passed", **fields: Any) -> TestCase:
    return TestCase(id=f"TestX.{name}", outcome=outcome, **fields)


def test_a_report_is_told_in_lines_and_each_episode_once() -> None:
    report = TestReport(
        outcome="failed",
        raised_in="tests",
        cases=(
            case("test_good", episode=EPISODE),
            case(
                "test_places",
                "failed",
                message="AssertionError: 1 != 2 : red is at 1",
                traceback=ASSERTED,
                raised_in="tests",
                episode=EPISODE,
                output="a\nb\n",
            ),
        ),
    )
    finding = StaticFinding(program="simulation", line=4, kind="unknown_asset", message="HOPE/Mlik.urdf")
    assert render_evidence(report, None, [finding]).splitlines() == [
        "== static checks",
        "simulation line 4: unknown_asset: HOPE/Mlik.urdf",
        "",
        "== tests",
        "failed: 1 of 2 tests passed",
        "TestX.test_places: failed: assertion failed in TestX.test_places, line 30: 1 != 2 : red is at 1",
        "  printed: a | b",
        "TestX.test_good: passed",
        "",
        "== oracle episode (TestX.test_places, TestX.test_good)",
        "outcome: step_limit",
        "published: 0.50  strict: 0.25  steps: 1/1",
        "detail: 1 of 2 objects at their goals",
        "goals:",
        "  worth 0.50, published 1.00, strict 0.50: inside HOPE/Milk.urdf #2 in box/box.urdf #1; "
        "misses: HOPE/Milk.urdf #2 is not below the rim",
        "actions:",
        "  1. HOPE/Milk.urdf #2 (0.300, 0.000, 0.100) -> (0.500, 0.000, 0.100): placed",
        "objects:",
        "  HOPE/Milk.urdf #2 (0.300, 0.000, 0.100) -> (0.500, 0.000, 0.200), tilted 90 degrees",
        "  box/box.urdf #1 (0.500, 0.000, 0.000), not moved",
        "warnings:",
        "  add_goal has no argument symmetry; it was ignored",
    ]


def test_an_error_is_shown_once_where_it_was_raised_without_the_library_around_it() -> None:
    cases = [
        case(name, "error", message="ValueError: no", traceback=TRACE, raised_in="simulation")
        for name in ("test_a", "test_b")
    ]
    lines = render_evidence(TestReport(outcome="error", cases=tuple(cases))).splitlines()
    assert lines[2:] == [
        "TestX.test_a: error (raised in simulation): ValueError: no",
        '    File "test_task_code.py", line 12, in setUp',
        "      self.env.reset()",
        '    File "task_code.py", line 7, in reset',
        '      raise ValueError("no")',
        "  ValueError: no",
        "TestX.test_b: error (raised in simulation): ValueError: no",
        "  as in TestX.test_a",
    ]


def test_a_program_that_cannot_be_imported_is_all_there_is() -> None:
    report = TestReport(outcome="error", message="NameError: x", traceback="NameError: x", raised_in="simulation")
    assert render_evidence(report).splitlines() == [
        "== tests",
        "error: 0 of 0 tests passed; NameError: x",
        "raised in: simulation",
        "  NameError: x",
    ]


def test_outcomes_that_a_name_does_not_explain_are_explained_and_foreign_episodes_left_out() -> None:
    report = TestReport(outcome="failed", cases=(case("test_a", "no_assertion", episode={"reward": "much"}),))
    text = render_evidence(report)
    assert "(no_assertion: a test counts only if" in text
    assert "oracle episode" not in text
    assert TestReport.model_validate_json(report.model_dump_json()) == report


def test_the_audit_tells_its_failures_and_the_seed_that_fell_shortest() -> None:
    goal = GoalOutcome(goal="g", worth=1.0, published=0.0, strict=0.0)
    motion = ObjectMotion(object=1, asset="a", start=(0, 0, 0), end=(0, 0, 0), tilt=0.0, moved=False)
    ends: list[tuple[int, Outcome, float]] = [(0, "success", 1.0), (1, "unreachable", 0.0)]
    rollouts = [
        Rollout(
            seed=seed,
            episode=Episode(
                outcome=outcome,
                reward=strict,
                strict=strict,
                steps=1,
                max_steps=2,
                detail="d",
                goals=(goal,),
                motions=(motion,),
            ),
            idle_reward=0.0,
            moved=(),
            initial={},
            final={},
            reachable=(),
        )
        for seed, outcome, strict in ends
    ]
    findings = (
        AuditFinding(check="solved", passed=False, measured="strict scores 1.00, 0.00", bound=""),
        AuditFinding(check="moved", passed=True, measured="", bound=""),
    )
    audit = AuditReport(accepted=False, findings=findings, changes=(), rollouts=tuple(rollouts), rewards=(1.0, 0.0))
    lines = render_evidence(None, audit).splitlines()
    assert lines[:5] == [
        "== audit",
        "failed: 1 of 2 checks hold: moved",
        "- solved: FAILED: strict scores 1.00, 0.00",
        "seed 0: success, published 1.00, strict 1.00, steps 1/2",
        "seed 1: unreachable, published 0.00, strict 0.00, steps 1/2",
    ]
    assert lines[6] == "== oracle episode (audit seed 1)"


def test_an_episode_that_a_test_and_the_audit_saw_is_told_once() -> None:
    episode = Episode.model_validate(EPISODE)
    rollout = Rollout(seed=0, episode=episode, idle_reward=0.0, moved=(), initial={}, final={}, reachable=())
    audit = AuditReport(accepted=False, findings=(), changes=(), rollouts=(rollout,), rewards=(0.5,))
    report = TestReport(outcome="passed", cases=(case("test_a", episode=EPISODE),))
    heads = [line for line in render_evidence(report, audit).splitlines() if line.startswith("== oracle")]
    assert heads == ["== oracle episode (TestX.test_a, audit seed 0)"]


def test_what_the_cup_loses_is_told_as_physics_and_painted_things_by_their_colour() -> None:
    note = "HOPE/Milk.urdf (0.98 kg) tipped off the cup: 0.27 N m bent it, it bears 0.15 N m"
    lost = {**EPISODE, "actions": [{**EPISODE["actions"][0], "note": note}]}
    lost["motions"] = [{**EPISODE["motions"][0], "color": "green"}]
    lines = render_evidence(TestReport(outcome="failed", cases=(case("test_a", "failed", episode=lost),))).splitlines()
    assert f"physics: the arm cannot hold HOPE/Milk.urdf there: {note}" in lines
    assert "  green box/box.urdf #1 (0.500, 0.000, 0.000), not moved" in lines


def test_of_many_tests_those_that_failed_are_shown() -> None:
    cases = [case(f"test_{number}") for number in range(500)]
    lines = render_evidence(TestReport(outcome="failed", cases=(*cases, case("test_z", "error")))).splitlines()
    assert lines[1:3] == ["failed: 500 of 501 tests passed", "TestX.test_z: error"]
    assert lines[-1] == "and 477 more tests" and len(lines) < 40


def test_nothing_run_is_said() -> None:
    assert render_evidence(None) == "(nothing was run)"
