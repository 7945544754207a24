"""A run as a self-contained HTML page. It leads with task, verdict, and film beside the photo (film first if the run
was rejected), followed by the steps in order. The page loads no external resource, and all foreign text is escaped."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any

from grs_agents.base.foreign.files import read_bytes
from grs_agents.base.foreign.run_folder import find_member_file
from grs_agents.base.trace.events import (
    Decision,
    Event,
    Finding,
    ProgramVersion,
    Reply,
    RunStarted,
    TaskDefined,
    TestsRun,
    ToolCall,
)
from grs_agents.views.common import event_markdown
from grs_agents.views.common.event_markdown import format_finding_verdict
from grs_agents.views.common.event_steps import Step, group_events_into_steps
from grs_agents.views.common.step_text import make_event_section
from grs_agents.views.report import html, pictures

_MAX_FAILURES = 3
"""Failures that are shown beside a fix."""
_MAX_SUMMARY = 240
"""Characters of a step's details in its heading."""


def render_html_report(record: dict[str, Any], events: Sequence[Event], sources: pictures.Sources) -> str:
    """The report of a run from its ``run.json``, its events and the files of its folder."""
    steps = group_events_into_steps(list(events))
    photo, drawn = pictures.merge_scene_stage_summaries(events), pictures.draw_last_audit_rollouts(events, sources)
    findings = pictures.last_audit_events(events, Finding)
    held = sum(finding.passed for finding in findings)
    audit = html.render_collapsible("each check", render_findings(findings), opened=held < len(findings))
    rejected = record.get("status") == "rejected"
    film = pictures.render_film(drawn, str(record.get("reason", "")) if rejected else "")
    twin = pictures.render_photo_or_twin(photo, sources.folder)
    programs: list[str] = []
    versions = {event.program: event for event in events if isinstance(event, ProgramVersion)}
    for program, event in versions.items():  # both programs in their last versions
        file = find_member_file(sources.folder, event.path)
        if file is not None:
            source = read_bytes(file).decode("utf-8", "replace")
            block = html.render_code_block(source)
            programs.append(html.render_collapsible(f"{program}, version {event.number}", block))
    counts: dict[str, Any] = record.get("counts") or {}
    seconds: dict[str, Any] = record.get("seconds") or {}
    figures = [*counts.items(), *((f"seconds of {key}", value) for key, value in seconds.items())]
    table = html.render_table(["what", "how much"], [(key.replace("_", " "), value) for key, value in figures], (1,))
    parts = [
        _render_header(record, events, steps),
        html.render_side_by_side(*((film, twin) if rejected else (twin, film))),
        html.render_section("Steps", *render_steps(steps)),
        html.render_section("The robot plays it", *pictures.render_rollouts(drawn)),
        html.render_section(f"Audit: {held} of {len(findings)} checks hold", audit) if findings else "",
        html.render_section("The scene", *pictures.render_scene(events, photo, sources)),
        html.render_section("The programs", *programs),
        html.render_section("Figures", html.render_collapsible("counts and seconds", table) if figures else ""),
        html.render_paragraph(f"Made by grs-agents {record.get('versions', {}).get('grs-agents', '')}.", "quiet"),
    ]
    return html.render_page(f"GRS run {record.get('id', '')}", [part for part in parts if part])


def _render_header(record: dict[str, Any], events: Sequence[Event], steps: Sequence[Step]) -> str:
    """The task in words, the verdict with its reason, and the effort."""
    status = str(record.get("status", "?"))
    tasks = [event.task for event in events if isinstance(event, TaskDefined)]
    task: dict[str, Any] = tasks[-1] if tasks else {}
    name = record.get("id", "run")
    title = task.get("task-description") or task.get("task-name") or name
    verdict = f'<b class="{"good" if status == "accepted" else "bad"}">{html.escape_html(status)}</b>'
    fields = (
        html.render_paragraph(f"{key}: {event_markdown.format_field_value(value)}", "quiet")
        for key, value in task.items()
        if key != "task-description"
    )
    facts = [str(name)]
    started = next((event for event in events if isinstance(event, RunStarted)), None)
    if started:
        facts += [f"graph {started.graph}", f"seed {started.seed}"]
    fixes = max((step.attempt for step in steps), default=0)
    tokens = sum(step.total_tokens for step in steps)
    calls = sum(len(step.model_replies) for step in steps)
    facts += [f"{fixes} fix{'' if fixes == 1 else 'es'}", f"{calls} model calls, {tokens:,} tokens"]
    costs = [step.cost for step in steps if step.cost is not None]
    if costs:
        facts.append(f"${sum(costs):.4f}" if sum(costs) else "they cost nothing")
    facts.append(f"{sum(step.seconds for step in steps):.1f} s")
    return (
        f"<header>{html.render_paragraph(' · '.join(facts), 'quiet')}\n"
        f"<h1>{html.escape_html(title)}</h1>\n"
        f'<p class="verdict">{verdict} {html.escape_html(record.get("reason", ""))}</p>{"".join(fields)}</header>'
    )


@dataclass
class _Evidence:
    """The latest failures, and the reason for the next fix."""

    failures: list[tuple[str, str]] = field(default_factory=list[tuple[str, str]])  # name of a test or check, details
    decision: Decision | None = None

    def add_step(self, step: Step) -> None:
        """Add the failures and the decision of ``step``."""
        failures: list[tuple[str, str]] = []
        for event in step.events:
            if isinstance(event, Decision):
                self.decision = event
            if isinstance(event, Finding) and not event.passed:
                failures.append((f"audit: {event.check}", event.detail))
            if isinstance(event, TestsRun):
                for case in event_markdown.get_test_cases(event):
                    if case.get("outcome") not in ("passed", "skipped"):
                        details = case.get("traceback") or case.get("message") or case.get("outcome")
                        failures.append((event_markdown.short_test_name(case), str(details)))
                if event.report.get("message"):
                    failures.append((str(event.report.get("outcome")), str(event.report["message"])))
        if failures or any(isinstance(event, TestsRun) for event in step.events):
            self.failures = failures


def render_steps(steps: Sequence[Step]) -> Iterator[str]:
    """Every step, with a heading for each fix. Fixes are expanded, and so is a failed last step."""
    evidence, attempt = _Evidence(), 0
    for step in steps:
        if step.attempt != attempt:
            attempt = step.attempt
            yield f"<h3>After fix {attempt}</h3>"
        fix = "".join(_render_program_fix(event, evidence) for event in step.events if _is_program_fix(event))
        opened = bool(fix) or (step is steps[-1] and bool(step.problem_summary))
        verdict, mark = ("bad", "✗") if step.problem_summary else ("good", "✓")
        visit = f" ×{step.visit}" if step.visit > 1 else ""
        effort = [f"{step.total_tokens:,} tokens"] if step.total_tokens else []
        effort += [f"${step.cost:.4f}"] if step.cost is not None else []
        effort.append(f"{step.seconds:.1f} s")
        details = step.details_as_text
        details = details if len(details) <= _MAX_SUMMARY else details[:_MAX_SUMMARY].rstrip() + " …"
        summary = (
            f'<summary><span class="{verdict}">{mark}</span> {step.number} '
            f"<b>{html.escape_html(step.node)}{visit}</b> "
            f'{html.escape_html(details)} <span class="quiet">{", ".join(effort)}</span></summary>'
        )
        body = fix + "".join(_render_events(step.events))
        yield f'<details class="step"{" open" if opened else ""}>{summary}\n{body}</details>'
        evidence.add_step(step)


def _is_program_fix(event: Event) -> bool:
    return isinstance(event, ProgramVersion) and event.parent is not None and bool(event.diff)


def _render_program_fix(event: Event, evidence: _Evidence) -> str:
    """A program's diff beside the failures and the decision to change it."""
    assert isinstance(event, ProgramVersion)
    reason = ""
    if (decision := evidence.decision) is not None:
        policy = f", by policy {decision.policy}" if decision.policy else ""
        head = html.escape_html(f"Why {decision.verdict}{policy}")
        reason = f"<h4>{head}</h4>{html.render_paragraph(decision.explanation)}"
    failures = [
        f'<h4 class="bad">{html.escape_html(name)}</h4>{html.render_code_block(text)}'
        for name, text in evidence.failures[:_MAX_FAILURES]
    ]
    hidden = len(evidence.failures) - _MAX_FAILURES
    rest = html.render_paragraph(f"and {hidden} more", "quiet") if hidden > 0 else ""
    author = f" by {event.author_role}" if event.author_role else ""
    version = html.escape_html(f"{event.program}, version {event.number}{author}")
    diff = f"<h4>{version}</h4>{html.render_diff(event.diff)}"
    return html.render_side_by_side(f"<div>{''.join(failures)}{rest}{reason}</div>", f"<div>{diff}</div>")


def _render_events(events: Iterable[Event]) -> Iterator[str]:
    findings: list[Finding] = []
    for event in events:
        match event:
            case Finding():
                findings.append(event)
            case TestsRun():
                yield render_tests(event)
            case ProgramVersion() if _is_program_fix(event):
                pass  # rendered above the events
            case _:
                section = make_event_section(event)
                if section is None:
                    continue
                if not section.text:
                    yield html.render_paragraph(section.heading)
                    continue
                failed = (isinstance(event, Reply) and event.error) or (isinstance(event, ToolCall) and not event.ok)
                block = html.render_code_block(section.text)
                yield html.render_collapsible(section.heading, block, False, "bad" if failed else "")
    if findings:
        yield render_findings(findings)


def render_tests(event: TestsRun) -> str:
    """A test run: each test in the colour of its outcome, failed tests with their tracebacks."""
    parts = [html.render_paragraph(event.report["message"], "bad")] if event.report.get("message") else []
    for case in event_markdown.get_test_cases(event):
        heading = f"{event_markdown.short_test_name(case)}: {case.get('outcome')} in {case.get('seconds') or 0:.2f} s"
        passed = case.get("outcome") in ("passed", "skipped")
        text = "\n".join(str(case[key]).rstrip() for key in ("message", "traceback", "output") if case.get(key))
        shown = html.render_code_block(text) if text else ""
        episode = event_markdown.format_oracle_episode(case)
        inner = shown + (html.render_paragraph(episode, "quiet") if episode else "")
        parts.append(html.render_collapsible(heading, inner, not passed, "good" if passed else "bad"))
    return "".join(parts)


def render_findings(findings: Sequence[Finding]) -> str:
    """The checks of an audit; failed checks in red."""
    cells = [(finding.check, format_finding_verdict(finding), finding.measured, finding.bound) for finding in findings]
    colors: list[html.Verdict] = ["" if finding.passed else "bad" for finding in findings]
    return html.render_table(["check", "", "measured", "asked"], cells, verdicts=colors)
