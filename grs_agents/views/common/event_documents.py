"""Events as Markdown for the viewer's text panels."""

from collections import Counter
from typing import Any, cast

from grs_agents import trace
from grs_agents.views.common.safe_text import cell, document, fenced

_HINT = (
    "Go back to the start on the time line below and press play: a second is one step, then the rollouts in real time. "
    "The tabs above show each stage."
)


def started(event: trace.RunStarted) -> str:
    """What the run is, before any decision."""
    return document(f"### Run {event.run_id}\n\nGraph **{event.graph}**, seed {event.seed}.\n\n{_HINT}\n")


def ended(event: trace.RunEnded) -> str:
    """The verdict on the run, and how to see its film: the viewer opens here."""
    return document(f"### {event.status}\n\n{event.reason}\n\n{_HINT}\n")


def decision(event: trace.Decision) -> str:
    """The router's verdict and reason."""
    policy = f" (policy {event.policy})" if event.policy else ""
    return document(f"### route → **{event.verdict}**{policy}\n\n{event.explanation}")


def prompt(event: trace.Prompt) -> str:
    """A prompt under a heading that says who asked whom."""
    pictures = f", {len(event.images)} picture{'s' * (len(event.images) > 1)}" if event.images else ""
    return document(f"**{event.role}** → {event.model}{pictures}\n\n---\n\n{event.text}")


def reply(event: trace.Reply) -> str:
    """A reply under a heading with tokens, seconds and what went wrong."""
    cost = f"{event.input_tokens} + {event.output_tokens} tokens, {event.seconds:.1f} s"
    head = f"{event.model} → **{event.role}**, {cost}"
    finish = f", {event.finish_reason}" if event.finish_reason else ""
    error = f"\n\n**Not used:** {event.error}" if event.error else ""
    return document(f"{head}{finish}{error}\n\n---\n\n{event.text}")


def program(event: trace.ProgramVersion, source: str) -> str:
    """A program with syntax colours."""
    author = f" by {event.author_role}" if event.author_role else ""
    head = f"**{event.path}**, version {event.number}{author}, sha256 {event.sha256[:10]}"
    return document(f"{head}\n\n{fenced(source, 'python')}")


def task(event: trace.TaskDefined) -> str:
    """The fields of the task."""
    lines = [f"- **{key}**: {_value(value)}" for key, value in event.task.items()]
    return document("### Task\n\n" + "\n".join(lines))


def _value(value: Any) -> str:
    return ", ".join(map(str, cast("list[Any]", value))) if isinstance(value, list) else str(value)


def tests(event: trace.TestsRun) -> str:
    """A test report as a table, then each traceback."""
    report = event.report
    cases = cases_of(event)
    parts = [f"### Tests: {report.get('outcome', '?')}", case_counts(event), str(report.get("message") or "")]
    if cases:
        rows = [
            f"| **{cell(case.get('outcome'))}** | {cell(_short(case))} | {case.get('seconds') or 0:.2f} "
            f"| {cell(case.get('message') or '')} |"
            for case in cases
        ]
        parts.append("\n".join(["| outcome | test | s | message |", "|---|---|---|---|", *rows]))
    for case in cases:
        parts.extend(_details(case))
    return document("\n\n".join(part for part in parts if part))


def _short(case: dict[str, Any]) -> str:
    """The test's own name: that of its class is long and the same for all, and would push the rest out of sight."""
    return str(case.get("id")).rpartition(".")[2]


def _details(case: dict[str, Any]) -> list[str]:
    traceback, episode = case.get("traceback"), case.get("episode")
    parts: list[str] = []
    if traceback:
        parts.append(f"**{case.get('id')}**\n\n{fenced(str(traceback), 'python')}")
    if episode and case.get("outcome") != "passed":
        parts.append(f"oracle: {episode.get('outcome')}, reward {episode.get('reward')}: {episode.get('detail')}")
    return parts


def cases_of(event: trace.TestsRun) -> list[dict[str, Any]]:
    """The test cases of a report; none where it broke off before any ran."""
    cases: list[dict[str, Any]] | None = event.report.get("cases")
    return cases or []


def case_counts(event: trace.TestsRun) -> str:
    """How many test cases of a report ended how, e.g. ``2 passed, 1 failed``; empty if none ran."""
    outcomes = Counter(str(case.get("outcome")) for case in cases_of(event))
    return ", ".join(f"{number} {outcome}" for outcome, number in outcomes.items())


def audit(findings: list[trace.Finding]) -> str:
    """What the audit has found so far, as a table."""
    rows = [
        f"| {cell(finding.check)} | **{finding_verdict(finding)}** | {cell(finding.detail)} |" for finding in findings
    ]
    return document("\n".join(["### Audit", "", "| check | | detail |", "|---|---|---|", *rows]))


def finding_verdict(finding: trace.Finding) -> str:
    """How a check of the audit came out, in a word."""
    return "passed" if finding.passed else "failed"
