"""Events as Markdown for the viewer's text panels."""

from collections import Counter
from typing import Any, cast

from grs_agents.base.trace.events import (
    Decision,
    Finding,
    ProgramVersion,
    Prompt,
    Reply,
    RunEnded,
    RunStarted,
    TaskDefined,
    TestsRun,
    ToolCall,
)
from grs_agents.views.common.safe_text import to_markdown_cell, to_markdown_code_block, to_viewer_markdown

_HINT = (
    "Go back to the start on the time line below and press play: a second is one step, then the rollouts in real time. "
    "The tabs above show each stage."
)


def format_run_start(event: RunStarted) -> str:
    """Run id, graph and seed."""
    return to_viewer_markdown(f"### Run {event.run_id}\n\nGraph **{event.graph}**, seed {event.seed}.\n\n{_HINT}\n")


def format_run_end(event: RunEnded) -> str:
    """The verdict with its reason, and a hint on playback: the viewer opens at this document."""
    return to_viewer_markdown(f"### {event.status}\n\n{event.reason}\n\n{_HINT}\n")


def format_decision(event: Decision) -> str:
    """The router's verdict and reason."""
    policy = f" (policy {event.policy})" if event.policy else ""
    return to_viewer_markdown(f"### route → **{event.verdict}**{policy}\n\n{event.explanation}")


def format_prompt(event: Prompt) -> str:
    """A prompt, headed by role and model."""
    pictures = f", {len(event.images)} picture{'s' * (len(event.images) > 1)}" if event.images else ""
    return to_viewer_markdown(f"**{event.role}** → {event.model}{pictures}\n\n---\n\n{event.text}")


def format_reply(event: Reply) -> str:
    """A reply, headed by tokens, seconds and error."""
    cost = f"{event.input_tokens} + {event.output_tokens} tokens, {event.seconds:.1f} s"
    head = f"{event.model} → **{event.role}**, {cost}"
    finish = f", {event.finish_reason}" if event.finish_reason else ""
    error = f"\n\n**Not used:** {event.error}" if event.error else ""
    return to_viewer_markdown(f"{head}{finish}{error}\n\n---\n\n{event.text}")


def format_tool_call(event: ToolCall) -> str:
    """A tool call with its arguments and result."""
    failed = "" if event.ok else ", **failed**"
    head = f"**{event.role}** calls **{event.tool}**{failed}, {event.seconds:.1f} s"
    arguments = [
        f"**{name}**\n\n{to_markdown_code_block(str(value), 'python')}" for name, value in event.arguments.items()
    ]
    return to_viewer_markdown("\n\n".join([head, *arguments, "---", to_markdown_code_block(event.result, "")]))


def format_program(event: ProgramVersion, source: str) -> str:
    """A program with syntax highlighting."""
    author = f" by {event.author_role}" if event.author_role else ""
    head = f"**{event.path}**, version {event.number}{author}, sha256 {event.sha256[:10]}"
    return to_viewer_markdown(f"{head}\n\n{to_markdown_code_block(source, 'python')}")


def format_task(event: TaskDefined) -> str:
    """The fields of the task."""
    lines = [f"- **{key}**: {format_field_value(value)}" for key, value in event.task.items()]
    return to_viewer_markdown("### Task\n\n" + "\n".join(lines))


def format_field_value(value: Any) -> str:
    """A field of the task as a single line."""
    return ", ".join(map(str, cast("list[Any]", value))) if isinstance(value, list) else str(value)


def format_test_report(event: TestsRun) -> str:
    """A test report as a table, followed by tracebacks and oracle episodes of failed tests."""
    report = event.report
    cases = get_test_cases(event)
    parts = [f"### Tests: {report.get('outcome', '?')}", format_outcome_counts(event), str(report.get("message") or "")]
    if cases:
        rows = [
            f"| **{to_markdown_cell(case.get('outcome'))}** | {to_markdown_cell(short_test_name(case))} "
            f"| {case.get('seconds') or 0:.2f} | {to_markdown_cell(case.get('message') or '')} |"
            for case in cases
        ]
        parts.append("\n".join(["| outcome | test | s | message |", "|---|---|---|---|", *rows]))
    for case in cases:
        if traceback := case.get("traceback"):
            parts.append(f"**{case.get('id')}**\n\n{to_markdown_code_block(str(traceback), 'python')}")
        if case.get("outcome") != "passed":
            parts.append(format_oracle_episode(case))
    return to_viewer_markdown("\n\n".join(part for part in parts if part))


def short_test_name(case: dict[str, Any]) -> str:
    """The method name of a test; the name of its class is long and the same for all tests."""
    return str(case.get("id")).rpartition(".")[2]


def format_oracle_episode(case: dict[str, Any]) -> str:
    """Result of the oracle's episode in a test; empty without an episode."""
    episode: dict[str, Any] = case.get("episode") or {}
    if not episode:
        return ""
    return f"oracle: {episode.get('outcome')}, reward {episode.get('reward')}: {episode.get('detail')}"


def get_test_cases(event: TestsRun) -> list[dict[str, Any]]:
    """Test cases of a report; empty if the run aborted before any test."""
    cases: list[dict[str, Any]] | None = event.report.get("cases")
    return cases or []


def format_outcome_counts(event: TestsRun) -> str:
    """Number of test cases by outcome, e.g. ``2 passed, 1 failed``; empty without test cases."""
    outcomes = Counter(str(case.get("outcome")) for case in get_test_cases(event))
    return ", ".join(f"{number} {outcome}" for outcome, number in outcomes.items())


def format_audit(findings: list[Finding]) -> str:
    """The findings of the audit so far, as a table."""
    rows = [
        f"| {to_markdown_cell(finding.check)} | **{format_finding_verdict(finding)}** "
        f"| {to_markdown_cell(finding.measured)} | {to_markdown_cell(finding.bound)} |"
        for finding in findings
    ]
    return to_viewer_markdown(
        "\n".join(["### Audit", "", "| check | | measured | asked |", "|---|---|---|---|", *rows])
    )


def format_finding_verdict(finding: Finding) -> str:
    """The outcome of an audit check."""
    return "passed" if finding.passed else "failed"
