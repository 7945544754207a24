"""Events as Markdown."""

from grs_agents.base.trace.events import (
    Decision,
    Finding,
    ProgramVersion,
    Prompt,
    Reply,
    RunEnded,
    RunStarted,
    TaskDefined,
)
from grs_agents.base.trace.events import TestsRun as Tested
from grs_agents.views.common import event_markdown


def test_a_report_is_a_table_with_tracebacks_below() -> None:
    failed = {
        "id": "T.test_b",
        "outcome": "failed",
        "seconds": 1.0,
        "message": "a|b",
        "traceback": "Traceback ``` x",
        "episode": {"outcome": "step_limit", "reward": 0.5, "detail": "two left"},
    }
    passed = {"id": "T.test_a", "outcome": "passed", "seconds": None, "message": None}
    text = event_markdown.format_test_report(Tested(report={"outcome": "failed", "cases": [passed, failed]}))
    assert "| **passed** | test_a | 0.00 |  |" in text
    assert "| **failed** | test_b | 1.00 | a\\|b |" in text
    assert "````python\nTraceback ``` x\n````" in text
    assert "oracle: step_limit, reward 0.5: two left" in text
    assert "1 passed, 1 failed" in text


def test_a_report_without_cases_says_why() -> None:
    text = event_markdown.format_test_report(Tested(report={"outcome": "error", "message": "SyntaxError: line 3"}))
    assert "Tests: error" in text
    assert "SyntaxError: line 3" in text


def test_each_document_holds_its_facts() -> None:
    prompt = Prompt(call="1", role="route", model="offline", text="## Task", images=("a.png",))
    reply = Reply(call="1", role="route", model="offline", text="```\nfix_code\n```", error="no fence", output_tokens=7)
    program = ProgramVersion(program="tests", number=2, sha256="ab" * 32, path="t.py", author_role="fix_tests")
    assert "**route** → offline, 1 picture" in event_markdown.format_prompt(prompt)
    assert "no fence" in event_markdown.format_reply(reply)
    assert "0 + 7 tokens" in event_markdown.format_reply(reply)
    assert "version 2 by fix_tests" in event_markdown.format_program(program, "x = 1\n")
    assert "**fix_code** (policy llm)" in event_markdown.format_decision(Decision(verdict="fix_code", policy="llm"))
    assert "- **assets-used**: a, b" in event_markdown.format_task(TaskDefined(task={"assets-used": ["a", "b"]}))
    assert "seed 4" in event_markdown.format_run_start(RunStarted(run_id="r", graph="grs", seed=4))
    assert "### rejected" in event_markdown.format_run_end(RunEnded(status="rejected", reason="fixes used up"))
    assert "| idle | **failed** | 1.0 |" in event_markdown.format_audit(
        [Finding(check="idle", passed=False, measured="1.0")]
    )
