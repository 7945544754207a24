"""The text that routers and fixers read."""

from grs_agents.sandbox import TestCase, TestReport

EPISODE = {
    "outcome": "step_limit",
    "reward": 0.5,
    "steps": 3,
    "max_steps": 3,
    "detail": "1 of 2 objects placed",
    "objects": ["HOPE/Milk.urdf"],
}


def test_failures_come_first_with_their_last_lines_and_episode() -> None:
    trace = "\n".join(f"line {number}" for number in range(40))
    report = TestReport(
        outcome="failed",
        raised_in="simulation",
        cases=(
            TestCase(id="TestX.test_good", outcome="passed"),
            TestCase(
                id="TestX.test_bad",
                outcome="failed",
                message="AssertionError: 0.5 != 1",
                traceback=trace,
                raised_in="tests",
                episode=EPISODE,
                output="a\nb\n",
            ),
        ),
    )
    lines = report.format_as_text().splitlines()
    assert lines[:3] == [
        "failed: 1 of 2 tests passed",
        "raised in: simulation",
        "TestX.test_bad: failed (raised in tests): AssertionError: 0.5 != 1",
    ]
    assert lines[3:18] == [f"  line {number}" for number in range(25, 40)]
    assert lines[18:] == [
        "  printed: a | b",
        '  oracle: outcome=step_limit reward=0.50 steps=3/3 detail=1 of 2 objects placed objects=["HOPE/Milk.urdf"]',
        "TestX.test_good: passed",
    ]
    assert not report.all_passed


def test_an_import_error_is_all_there_is() -> None:
    report = TestReport(outcome="error", message="NameError: x", traceback="T", raised_in="simulation")
    assert report.format_as_text() == "error: 0 of 0 tests passed; NameError: x\nraised in: simulation\n  T"


def test_a_strange_episode_is_shown_all_the_same() -> None:
    report = TestReport(outcome="passed", cases=(TestCase(id="T.t", outcome="passed", episode={"reward": "much"}),))
    assert "reward=much" in report.format_as_text()
    assert report.all_passed
    assert TestReport.model_validate_json(report.model_dump_json()) == report
