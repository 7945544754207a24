"""One step in full: the exact prompts, replies, diffs and tracebacks of a visit of a node, as plain text."""

import json
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

from grs_agents.base.errors import InputError
from grs_agents.base.trace.events import (
    Decision,
    Event,
    Finding,
    NodeEnded,
    Note,
    ProgramVersion,
    Prompt,
    Reply,
    Rollout,
    SceneStage,
    TaskDefined,
    TestsRun,
    ToolCall,
)
from grs_agents.views.common.event_markdown import (
    format_finding_verdict,
    format_oracle_episode,
    format_outcome_counts,
    get_test_cases,
)
from grs_agents.views.common.event_steps import Step


@dataclass(frozen=True)
class Section:
    """A heading and the text below it."""

    heading: str
    text: str = ""


def find_step_by_number(rows: list[Step], number: int) -> Step:
    """The step called ``number``. Raises InputError: the run has no such step."""
    if not 1 <= number <= len(rows):
        raise InputError(f"the run has no step {number}", f"name one of 1 to {len(rows)}" if rows else "it has none")
    return rows[number - 1]


def find_last_failed_step(rows: list[Step]) -> Step | None:
    """The last step in which something went wrong; None if nothing did."""
    return next((step for step in reversed(rows) if step.problem_summary), None)


def iter_step_sections(step: Step) -> Iterator[Section]:
    """All that happened in ``step``, in order."""
    for event in step.events:
        section = make_event_section(event)
        if section:
            yield section


def make_event_section(event: Event) -> Section | None:
    """``event`` under a heading; None for what needs no words."""
    match event:
        case Prompt() | Reply() | ToolCall():
            section = _make_exchange_section(event)
        case ProgramVersion():
            section = Section(f"{event.program} version {event.number}, {event.path}", event.diff)
        case TestsRun():
            section = Section(f"tests: {event.report.get('outcome')}", _format_test_report(event))
        case Decision():
            section = Section(f"decision of policy {event.policy}: {event.verdict}", event.explanation)
        case TaskDefined():
            section = Section("task", json.dumps(event.task, indent=2, ensure_ascii=False))
        case SceneStage():
            section = _make_scene_section(event)
        case Rollout():
            section = _make_rollout_section(event)
        case Finding():
            section = _make_finding_section(event)
        case Note():
            section = Section(event.level, event.text)
        case NodeEnded():
            section = _make_node_end_section(event)
        case _:
            section = None
    return section


def _make_exchange_section(event: Prompt | Reply | ToolCall) -> Section:
    if isinstance(event, Prompt):
        return _make_prompt_section(event)
    return _make_reply_section(event) if isinstance(event, Reply) else _make_tool_call_section(event)


def _make_prompt_section(event: Prompt) -> Section:
    pictures = "".join(f"\n[picture {name}]" for name in event.images)
    return Section(f"prompt of {event.role} to {event.model} (call {event.call})", event.text + pictures)


def _make_tool_call_section(event: ToolCall) -> Section:
    asked = "\n".join(f"{name}: {value}" for name, value in event.arguments.items())
    failed = "" if event.ok else ", failed"
    heading = f"{event.role} calls {event.tool}{failed}, {event.seconds:.1f} s"
    return Section(heading, f"{asked}\n\n{event.result}".strip())


def _make_scene_section(event: SceneStage) -> Section:
    return Section(f"scene: {event.stage}", "\n".join(f"[{kind} {name}]" for kind, name in event.files.items()))


def _make_rollout_section(event: Rollout) -> Section:
    moved = f"moved {', '.join(event.moved)}" if event.moved else "moved nothing"
    text = f"{event.steps} steps, doing nothing earns {event.idle_reward:.2f}; {moved}"
    return Section(f"rollout of seed {event.seed}: {event.outcome}, reward {event.reward:.2f}", text)


def _make_finding_section(event: Finding) -> Section:
    asked = f"\nasked: {event.bound}" if event.bound else ""
    return Section(f"audit, {event.check}: {format_finding_verdict(event)}", event.measured + asked)


def _make_node_end_section(event: NodeEnded) -> Section | None:
    """What the node made of the state, or the error that ended it."""
    if event.error:
        return Section("error", event.error)
    lines = [f"{key}: {json.dumps(value, ensure_ascii=False)}" for key, value in event.values.items()]
    return Section("state", "\n".join(lines)) if lines else None


def _make_reply_section(event: Reply) -> Section:
    cached = f" ({event.cached_tokens} from the cache)" if event.cached_tokens else ""
    cost = "" if event.cost is None else f", ${event.cost:.4f}"
    ending = f", {event.finish_reason}" if event.finish_reason else ""
    spent = f"{event.input_tokens} tokens in{cached}, {event.output_tokens} out{cost}, {event.seconds:.1f} s{ending}"
    heading = f"reply of {event.model} to {event.role} (call {event.call}): {spent}"
    return Section(heading, event.text + (f"\n\nnot used: {event.error}" if event.error else ""))


def _format_test_report(event: TestsRun) -> str:
    message = str(event.report.get("message") or "")
    parts = [format_outcome_counts(event), message, *map(_format_test_case, get_test_cases(event))]
    return "\n\n".join(part for part in parts if part)


def _format_test_case(case: dict[str, Any]) -> str:
    message = f": {case['message']}" if case.get("message") else ""
    lines = [f"{case.get('id')}: {case.get('outcome')} in {case.get('seconds') or 0:.2f} s{message}"]
    lines += [str(case[key]).rstrip() for key in ("traceback", "output") if case.get(key)]
    return "\n".join(filter(None, [*lines, format_oracle_episode(case)]))
