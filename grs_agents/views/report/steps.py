"""The steps of a run in their order, each folded: prompts and replies, tests, and each fix as what changed beside what
had failed and the reason for the fix."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field

from grs_agents.base.trace.events import Decision, Event, Finding, ProgramVersion, Reply, TestsRun, ToolCall
from grs_agents.views.common import event_markdown
from grs_agents.views.common.event_markdown import format_finding_verdict
from grs_agents.views.common.event_steps import Step
from grs_agents.views.common.step_text import make_event_section
from grs_agents.views.report import html

_FEW = 3
"""Failures that are shown beside a fix."""
_LONGEST = 240
"""Characters of what came of a step, in its heading."""


@dataclass
class _Evidence:
    """What the next fix answers: the failures found last, and the reason for the fix."""

    failures: list[tuple[str, str]] = field(default_factory=list[tuple[str, str]])  # what failed, and how
    decision: Decision | None = None

    def add_step(self, step: Step) -> None:
        """Take in what ``step`` found."""
        found = [failure for event in step.events for failure in _list_failures_in_event(event)]
        if found or any(isinstance(event, TestsRun) for event in step.events):
            self.failures = found
        for event in step.events:
            if isinstance(event, Decision):
                self.decision = event


def _list_failures_in_event(event: Event) -> Iterator[tuple[str, str]]:
    if isinstance(event, Finding) and not event.passed:
        yield f"audit: {event.check}", event.detail
    if isinstance(event, TestsRun):
        for case in event_markdown.get_test_cases(event):
            if case.get("outcome") not in ("passed", "skipped"):
                what = case.get("traceback") or case.get("message") or case.get("outcome")
                yield event_markdown.short_test_name(case), str(what)
        if event.report.get("message"):
            yield str(event.report.get("outcome")), str(event.report["message"])


def render_steps(steps: Sequence[Step]) -> Iterator[str]:
    """Every step, under a heading for each fix. Fixes are open, and so is the last step if it went wrong."""
    evidence, attempt = _Evidence(), 0
    for step in steps:
        if step.attempt != attempt:
            attempt = step.attempt
            yield f"<h3>After fix {attempt}</h3>"
        fix = "".join(_render_program_fix(event, evidence) for event in step.events if _is_program_fix(event))
        body = fix + "".join(_render_events(step.events))
        opened = bool(fix) or (step is steps[-1] and bool(step.problem_summary))
        yield _render_step(step, body, opened)
        evidence.add_step(step)


def _render_step(step: Step, body: str, opened: bool) -> str:
    verdict, mark = ("bad", "✗") if step.problem_summary else ("good", "✓")
    visit = f" ×{step.visit}" if step.visit > 1 else ""
    spent = [f"{step.total_tokens:,} tokens"] if step.total_tokens else []
    spent += [f"${step.cost:.4f}"] if step.cost is not None else []
    told = step.details_as_text
    told = told if len(told) <= _LONGEST else told[:_LONGEST].rstrip() + " …"
    summary = (
        f'<summary><span class="{verdict}">{mark}</span> {step.number} <b>{html.escape_html(step.node)}{visit}</b> '
        f'{html.escape_html(told)} <span class="quiet">{", ".join([*spent, f"{step.seconds:.1f} s"])}</span></summary>'
    )
    return f'<details class="step"{" open" if opened else ""}>{summary}\n{body}</details>'


def _is_program_fix(event: Event) -> bool:
    return isinstance(event, ProgramVersion) and event.parent is not None and bool(event.diff)


def _render_program_fix(event: Event, evidence: _Evidence) -> str:
    """What changed, beside what had failed and why this program was to change."""
    assert isinstance(event, ProgramVersion)
    why = evidence.decision
    head = f"Why {why.verdict}" + (f", by policy {why.policy}" if why.policy else "") if why else ""
    reason = f"<h4>{html.escape_html(head)}</h4>{html.render_paragraph(why.explanation)}" if why else ""
    failures = [
        f'<h4 class="bad">{html.escape_html(name)}</h4>{html.render_code_block(text)}'
        for name, text in evidence.failures[:_FEW]
    ]
    more = len(evidence.failures) - _FEW
    rest = html.render_paragraph(f"and {more} more", "quiet") if more > 0 else ""
    changed = f"<h4>{html.escape_html(_format_program_version(event))}</h4>{html.render_diff(event.diff)}"
    return html.render_side_by_side(f"<div>{''.join(failures)}{rest}{reason}</div>", f"<div>{changed}</div>")


def _format_program_version(event: ProgramVersion) -> str:
    author = f" by {event.author_role}" if event.author_role else ""
    return f"{event.program}, version {event.number}{author}"


def _render_events(events: Iterable[Event]) -> Iterator[str]:
    findings: list[Finding] = []
    for event in events:
        match event:
            case Finding():
                findings.append(event)
            case TestsRun():
                yield render_tests(event)
            case ProgramVersion() if _is_program_fix(event):
                pass  # stands above
            case _:
                yield _render_section(event)
    if findings:
        yield render_findings(findings)


def _render_section(event: Event) -> str:
    section = make_event_section(event)
    if section is None:
        return ""
    failed = (isinstance(event, Reply) and event.error) or (isinstance(event, ToolCall) and not event.ok)
    if section.text:
        return html.render_collapsible(
            section.heading, html.render_code_block(section.text), False, "bad" if failed else ""
        )
    return html.render_paragraph(section.heading)


def render_tests(event: TestsRun) -> str:
    """A run of the tests: each test in the colour of its outcome, with the traceback of those that failed."""
    parts = [html.render_paragraph(event.report["message"], "bad")] if event.report.get("message") else []
    for case in event_markdown.get_test_cases(event):
        heading = f"{event_markdown.short_test_name(case)}: {case.get('outcome')} in {case.get('seconds') or 0:.2f} s"
        well = case.get("outcome") in ("passed", "skipped")
        text = "\n".join(str(case[key]).rstrip() for key in ("message", "traceback", "output") if case.get(key))
        shown = html.render_code_block(text) if text else ""
        episode = event_markdown.format_oracle_episode(case)
        inner = shown + (html.render_paragraph(episode, "quiet") if episode else "")
        parts.append(html.render_collapsible(heading, inner, not well, "good" if well else "bad"))
    return "".join(parts)


def render_findings(findings: Sequence[Finding]) -> str:
    """The checks of an audit, those that failed in red."""
    cells = [(one.check, format_finding_verdict(one), one.measured, one.bound) for one in findings]
    colors: list[html.Verdict] = ["" if one.passed else "bad" for one in findings]
    return html.render_table(["check", "", "measured", "asked"], cells, verdicts=colors)
