"""A run as a self-contained HTML page. It leads with task, verdict, and film beside the photo (film first if the run
was rejected), followed by the steps in order. The template escapes all foreign text."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from grs_agents.base.foreign.files import read_bytes
from grs_agents.base.foreign.run_folder import find_member_file
from grs_agents.base.templates import load_template
from grs_agents.base.trace.events import (
    Decision,
    Event,
    Finding,
    ProgramVersion,
    RunStarted,
    TaskDefined,
    TestsRun,
)
from grs_agents.views.common import event_markdown
from grs_agents.views.common.event_steps import Step, group_events_into_steps
from grs_agents.views.common.step_text import Section, make_event_section
from grs_agents.views.report import pictures

POLICY = "default-src 'none'; img-src data:; style-src 'unsafe-inline'; base-uri 'none'; form-action 'none'"
_MAX_FAILURES = 3
"""Failures that are shown beside a fix."""
_MAX_DETAILS = 240
"""Characters of a step's details in its heading."""


def render_html_report(record: dict[str, Any], events: Sequence[Event], sources: pictures.Sources) -> str:
    """The report of a run from its ``run.json``, its events and the files of its folder."""
    steps = group_events_into_steps(list(events))
    tasks = [event.task for event in events if isinstance(event, TaskDefined)]
    status, photo = str(record.get("status", "?")), pictures.merge_scene_stage_summaries(events)
    drawn = pictures.draw_last_audit_rollouts(events, sources)
    sources.report_drawing_progress("the camera's view of the simulation")
    annotated = pictures.make_annotated_photo(photo, sources.folder)
    view, view_problem = pictures.draw_task_view(events, sources, photo.camera)
    counts: dict[str, Any] = record.get("counts") or {}
    seconds: dict[str, Any] = record.get("seconds") or {}
    return load_template(Path(__file__).with_name("report.html")).render(
        record=record,
        status=status,
        task=tasks[-1] if tasks else {},
        facts=_list_facts(record, events, steps),
        film=pictures.make_film(drawn, str(record.get("reason", "")) if status == "rejected" else ""),
        twin=pictures.make_photo_over_twin(photo.files, sources.folder) or annotated,
        steps=list(_describe_steps(steps)),
        drawn=drawn,
        findings=pictures.last_audit_events(events, Finding),
        photo=annotated,
        view=view,
        view_problem=view_problem,
        objects=pictures.describe_objects(events, photo, sources.folder),
        programs=[
            (event, read_bytes(file).decode("utf-8", "replace"))
            for event in {event.program: event for event in events if isinstance(event, ProgramVersion)}.values()
            if (file := find_member_file(sources.folder, event.path)) is not None
        ],
        figures=[
            (key.replace("_", " "), value)
            for key, value in (*counts.items(), *((f"seconds of {key}", value) for key, value in seconds.items()))
        ],
        join_case_text=_join_case_text,
        short_test_name=event_markdown.short_test_name,
        get_test_cases=event_markdown.get_test_cases,
        format_field_value=event_markdown.format_field_value,
        format_finding_verdict=event_markdown.format_finding_verdict,
        format_oracle_episode=event_markdown.format_oracle_episode,
        MAX_FAILURES=_MAX_FAILURES,
        POLICY=POLICY,
    )


def _list_facts(record: dict[str, Any], events: Sequence[Event], steps: Sequence[Step]) -> list[str]:
    """Name, graph, seed and effort of a run."""
    facts = [str(record.get("id", "run"))]
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
    return facts


@dataclass(frozen=True)
class _StepView:
    """A step as its template shows it."""

    number: int
    node: str
    attempt: int
    details: str
    effort: list[str]
    failed: bool
    opened: bool
    fixes: list[ProgramVersion]
    failures: list[tuple[str, str]]  # latest before the step: name of a test or check, details
    decision: Decision | None  # latest before the step
    sections: list[tuple[Event, Section]]
    findings: list[Finding]


def _describe_steps(steps: Sequence[Step]) -> Iterator[_StepView]:
    """Every step with the evidence before it. Fixes are opened, and so is a failed last step."""
    failures: list[tuple[str, str]] = []
    decision: Decision | None = None
    for step in steps:
        fixes = [event for event in step.events if _is_program_fix(event)]
        shown = [event for event in step.events if not isinstance(event, Finding) and not _is_program_fix(event)]
        effort = [f"{step.total_tokens:,} tokens"] if step.total_tokens else []
        effort += [f"${step.cost:.4f}"] if step.cost is not None else []
        details = step.details_as_text
        yield _StepView(
            step.number,
            f"{step.node} ×{step.visit}" if step.visit > 1 else step.node,
            step.attempt,
            details if len(details) <= _MAX_DETAILS else details[:_MAX_DETAILS].rstrip() + " …",
            [*effort, f"{step.seconds:.1f} s"],
            bool(step.problem_summary),
            bool(fixes) or (step is steps[-1] and bool(step.problem_summary)),
            [event for event in fixes if isinstance(event, ProgramVersion)],
            failures,
            decision,
            [(event, section) for event in shown if (section := make_event_section(event)) is not None],
            [event for event in step.events if isinstance(event, Finding)],
        )
        decision = next((event for event in reversed(step.events) if isinstance(event, Decision)), decision)
        failed = list(_list_failures(step))
        if failed or any(isinstance(event, TestsRun) for event in step.events):
            failures = failed


def _is_program_fix(event: Event) -> bool:
    return isinstance(event, ProgramVersion) and event.parent is not None and bool(event.diff)


def _list_failures(step: Step) -> Iterator[tuple[str, str]]:
    """Failed checks and tests of a step: name, details."""
    for event in step.events:
        if isinstance(event, Finding) and not event.passed:
            yield f"audit: {event.check}", event.detail
        if isinstance(event, TestsRun):
            for case in event_markdown.get_test_cases(event):
                if case.get("outcome") not in ("passed", "skipped"):
                    details = case.get("traceback") or case.get("message") or case.get("outcome")
                    yield event_markdown.short_test_name(case), str(details)
            if event.report.get("message"):
                yield str(event.report.get("outcome")), str(event.report["message"])


def _join_case_text(case: dict[str, Any]) -> str:
    return "\n".join(str(case[key]).rstrip() for key in ("message", "traceback", "output") if case.get(key))
