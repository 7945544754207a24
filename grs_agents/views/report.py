"""A run as one HTML page to send to somebody who has none of this installed."""

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, cast

from grs_agents.foreign import present, read_bytes
from grs_agents.trace import (
    Decision,
    Event,
    Finding,
    NodeStarted,
    ProgramVersion,
    RunStarted,
    TaskDefined,
    TestsRun,
)
from grs_agents.views.common.step_text import sections
from grs_agents.views.common.steps import Step, steps
from grs_agents.views.page import Verdict, code, diff, folded, page, paragraph, section, table, text
from grs_agents.views.report_pictures import Sources, photo, rollouts


def report(record: dict[str, Any], events: Sequence[Event], sources: Sources) -> str:
    """The page.

    Args:
        record: the content of ``run.json``.
        events: of the run.
        sources: where its pictures, assets and programs are.
    """
    rows = steps(list(events))
    parts = [
        _head(record, events),
        section("The photo", *photo(events, sources)),
        section("The task", *_task(events)),
        section("The oracle plays it", *rollouts(events, sources)),
        section("How it came about", _steps(rows)),
        section("Decisions", *_decisions(events)),
        section("Tests", *_tests(rows)),
        section("Audit", _findings(events)),
        section("Programs", *_programs(events, sources.folder)),
        paragraph(f"Made by grs-agents {record.get('versions', {}).get('grs-agents', '')}.", "quiet"),
    ]
    return page(f"GRS run {record.get('id', '')}", [part for part in parts if part])


def _head(record: dict[str, Any], events: Sequence[Event]) -> str:
    status = str(record.get("status", "?"))
    started = next((event for event in events if isinstance(event, RunStarted)), None)
    kind = "good" if status == "accepted" else "bad"
    how = f"graph {started.graph}, seed {started.seed}" if started else ""
    counts: dict[str, Any] = record.get("counts") or {}
    seconds: dict[str, Any] = record.get("seconds") or {}
    counted = {**counts, "seconds": seconds.get("total", "?")}
    figures = table(["what", "how much"], [(key.replace("_", " "), value) for key, value in counted.items()])
    return (
        f"<header><h1>{text(record.get('id', 'run'))}</h1>\n"
        f'<p><span class="status {kind}">{text(status)}</span> {text(record.get("reason", ""))}</p>'
        + paragraph(how, "quiet")
        + folded("Figures", figures)
        + "</header>"
    )


def _task(events: Sequence[Event]) -> Iterator[str]:
    tasks = [event.task for event in events if isinstance(event, TaskDefined)]
    for key, value in (tasks[-1] if tasks else {}).items():
        shown = ", ".join(map(str, cast("list[Any]", value))) if isinstance(value, list) else value
        yield f"<p><b>{text(key)}</b>: {text(shown)}</p>"


def _steps(rows: Sequence[Step]) -> str:
    cells = [
        (step.number, step.attempt, f"{step.node}{f' ×{step.visit}' if step.visit > 1 else ''}", _status(step),
         f"{step.seconds:.1f}", f"{step.tokens:,}" if step.tokens else "", step.detail[:1000])
        for step in rows
    ]  # fmt: skip
    heads = ["#", "fix", "step", "status", "seconds", "tokens", "what came of it"]
    return table(heads, cells, (0, 1, 4, 5), [_verdict(not step.trouble) for step in rows]) if rows else ""


def _status(step: Step) -> str:
    """How a step ended; of one that did its work and found faults, that."""
    return "found faults" if step.status == "done" and step.trouble else step.status


def _verdict(well: bool) -> Verdict:
    return "" if well else "bad"


def _decisions(events: Sequence[Event]) -> Iterator[str]:
    for event in events:
        if isinstance(event, Decision):
            policy = f" by {event.policy}" if event.policy else ""
            yield f"<p><b>{text(event.verdict)}</b>{text(policy)}: {text(event.explanation)}</p>"


def _tests(rows: Sequence[Step]) -> Iterator[str]:
    """Each run of the tests in full; the last one is open if it failed."""
    runs = [step for step in rows if any(isinstance(event, TestsRun) for event in step.events)]
    for step in runs:
        told = "\n\n".join(f"{part.heading}\n{part.text}" for part in sections(step))
        last = step is runs[-1]
        heading = f"step {step.number}: {step.detail}"
        yield folded(heading, code(told), opened=last and bool(step.trouble), verdict=_verdict(not step.trouble))


def _findings(events: Sequence[Event]) -> str:
    """What the last audit found."""
    found: list[Finding] = []
    for event in events:
        if isinstance(event, NodeStarted) and event.node == "audit":
            found.clear()
        elif isinstance(event, Finding):
            found.append(event)
    cells = [(event.check, "passed" if event.passed else "failed", event.detail) for event in found]
    return table(["check", "", "detail"], cells, verdicts=[_verdict(event.passed) for event in found]) if cells else ""


def _programs(events: Sequence[Event], folder: Path) -> Iterator[str]:
    """Each version as what it changed, then both programs as they ended."""
    last: dict[str, ProgramVersion] = {}
    for event in events:
        if isinstance(event, ProgramVersion):
            last[event.program] = event
            if event.parent is not None and event.diff:
                yield folded(f"{event.program} version {event.number} by {event.author_role}", diff(event.diff), True)
    for program, event in last.items():
        file = present(folder, event.path)
        if file is not None:
            source = read_bytes(file).decode("utf-8", "replace")
            yield folded(f"{program}, version {event.number}, whole", code(source))
