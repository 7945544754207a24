"""A run as one HTML page to send to somebody who has none of this installed.
It leads with the task, the verdict and the film beside the photo, of a rejected run with the film first; then come the
steps in their order. The page needs nothing from anywhere, and all text from outside is escaped."""

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from grs_agents.base.foreign.files import read_bytes
from grs_agents.base.foreign.run_folder import find_member_file
from grs_agents.base.trace.events import Event, Finding, ProgramVersion, RunStarted, TaskDefined
from grs_agents.views.common import event_markdown
from grs_agents.views.common.event_steps import Step, group_events_into_steps
from grs_agents.views.report import html, pictures
from grs_agents.views.report.steps import render_findings, render_steps


def render_html_report(record: dict[str, Any], events: Sequence[Event], sources: pictures.Sources) -> str:
    """The page."""
    steps = group_events_into_steps(list(events))
    photo, drawn = pictures.merge_scene_stage_summaries(events), pictures.draw_last_audit_rollouts(events, sources)
    findings = pictures.last_audit_events(events, Finding)
    held = sum(finding.passed for finding in findings)
    audit = html.render_collapsible("each check", render_findings(findings), opened=held < len(findings))
    rejected = record.get("status") == "rejected"
    film = pictures.render_film(drawn, str(record.get("reason", "")) if rejected else "")
    twin = pictures.render_photo_or_twin(photo, sources.folder)
    parts = [
        _render_header(record, events, steps),
        html.render_side_by_side(*((film, twin) if rejected else (twin, film))),
        html.render_section("Steps", *render_steps(steps)),
        html.render_section("The robot plays it", *pictures.render_rollouts(drawn)),
        html.render_section(f"Audit: {held} of {len(findings)} checks hold", audit) if findings else "",
        html.render_section("The scene", *pictures.render_scene(events, photo, sources)),
        html.render_section("The programs", *_render_programs(events, sources.folder)),
        html.render_section("Figures", _render_counts_and_seconds(record)),
        html.render_paragraph(f"Made by grs-agents {record.get('versions', {}).get('grs-agents', '')}.", "quiet"),
    ]
    return html.render_page(f"GRS run {record.get('id', '')}", [part for part in parts if part])


def _render_header(record: dict[str, Any], events: Sequence[Event], steps: Sequence[Step]) -> str:
    """The task in words, the verdict with its reason, and what it took."""
    status = str(record.get("status", "?"))
    tasks = [event.task for event in events if isinstance(event, TaskDefined)]
    task: dict[str, Any] = tasks[-1] if tasks else {}
    name = record.get("id", "run")
    title = task.get("task-description") or task.get("task-name") or name
    verdict = f'<b class="{"good" if status == "accepted" else "bad"}">{html.escape_html(status)}</b>'
    others = (
        html.render_paragraph(f"{key}: {event_markdown.format_field_value(value)}", "quiet")
        for key, value in task.items()
        if key != "task-description"
    )
    return (
        f"<header>{html.render_paragraph(' · '.join(_list_header_facts(record, events, steps)), 'quiet')}\n"
        f"<h1>{html.escape_html(title)}</h1>\n"
        f'<p class="verdict">{verdict} {html.escape_html(record.get("reason", ""))}</p>{"".join(others)}</header>'
    )


def _list_header_facts(record: dict[str, Any], events: Sequence[Event], steps: Sequence[Step]) -> Iterator[str]:
    yield str(record.get("id", "run"))
    started = next((event for event in events if isinstance(event, RunStarted)), None)
    if started:
        yield f"graph {started.graph}"
        yield f"seed {started.seed}"
    fixes = max((step.attempt for step in steps), default=0)
    yield f"{fixes} fix{'' if fixes == 1 else 'es'}"
    tokens = sum(step.total_tokens for step in steps)
    yield f"{sum(len(step.model_replies) for step in steps)} model calls, {tokens:,} tokens"
    costs = [step.cost for step in steps if step.cost is not None]
    if costs:
        yield f"${sum(costs):.4f}" if sum(costs) else "they cost nothing"
    yield f"{sum(step.seconds for step in steps):.1f} s"


def _render_counts_and_seconds(record: dict[str, Any]) -> str:
    counts: dict[str, Any] = record.get("counts") or {}
    seconds: dict[str, Any] = record.get("seconds") or {}
    rows = [*counts.items(), *((f"seconds of {key}", value) for key, value in seconds.items())]
    table = html.render_table(["what", "how much"], [(key.replace("_", " "), value) for key, value in rows], (1,))
    return html.render_collapsible("counts and seconds", table) if rows else ""


def _render_programs(events: Sequence[Event], folder: Path) -> Iterator[str]:
    """Both programs as they ended."""
    last = {event.program: event for event in events if isinstance(event, ProgramVersion)}
    for program, event in last.items():
        file = find_member_file(folder, event.path)
        if file is not None:
            source = read_bytes(file).decode("utf-8", "replace")
            yield html.render_collapsible(f"{program}, version {event.number}", html.render_code_block(source))
