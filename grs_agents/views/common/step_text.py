"""Full text of a step: prompts, replies, diffs and tracebacks of a node's visit."""

import json
from collections.abc import Iterator
from dataclasses import dataclass

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
    """A heading and its text."""

    heading: str
    text: str = ""


def find_step_by_number(rows: list[Step], number: int) -> Step:
    """The step with this number. Raises InputError: no such step."""
    if not 1 <= number <= len(rows):
        raise InputError(f"the run has no step {number}", f"name one of 1 to {len(rows)}" if rows else "it has none")
    return rows[number - 1]


def find_last_failed_step(rows: list[Step]) -> Step | None:
    """The last step with a problem; None without problems."""
    return next((step for step in reversed(rows) if step.problem_summary), None)


def iter_step_sections(step: Step) -> Iterator[Section]:
    """The sections of the events of ``step``, in order."""
    for event in step.events:
        section = make_event_section(event)
        if section:
            yield section


def make_event_section(event: Event) -> Section | None:
    """``event`` as a heading with text; None for events without text."""
    match event:
        case Prompt():
            pictures = "".join(f"\n[picture {name}]" for name in event.images)
            heading = f"prompt of {event.role} to {event.model} (call {event.call})"
            section = Section(heading, event.text + pictures)
        case Reply():
            cached = f" ({event.cached_tokens} from the cache)" if event.cached_tokens else ""
            cost = "" if event.cost is None else f", ${event.cost:.4f}"
            ending = f", {event.finish_reason}" if event.finish_reason else ""
            tokens = f"{event.input_tokens} tokens in{cached}, {event.output_tokens} out"
            usage = f"{tokens}{cost}, {event.seconds:.1f} s{ending}"
            heading = f"reply of {event.model} to {event.role} (call {event.call}): {usage}"
            section = Section(heading, event.text + (f"\n\nnot used: {event.error}" if event.error else ""))
        case ToolCall():
            failed = "" if event.ok else ", failed"
            arguments = "\n".join(f"{name}: {value}" for name, value in event.arguments.items())
            heading = f"{event.role} calls {event.tool}{failed}, {event.seconds:.1f} s"
            section = Section(heading, f"{arguments}\n\n{event.result}".strip())
        case ProgramVersion():
            section = Section(f"{event.program} version {event.number}, {event.path}", event.diff)
        case TestsRun():
            parts = [format_outcome_counts(event), str(event.report.get("message") or "")]
            for case in get_test_cases(event):
                message = f": {case['message']}" if case.get("message") else ""
                details = [f"{case.get('id')}: {case.get('outcome')} in {case.get('seconds') or 0:.2f} s{message}"]
                details += [str(case[key]).rstrip() for key in ("traceback", "output") if case.get(key)]
                parts.append("\n".join(filter(None, [*details, format_oracle_episode(case)])))
            section = Section(f"tests: {event.report.get('outcome')}", "\n\n".join(filter(None, parts)))
        case Decision():
            section = Section(f"decision of policy {event.policy}: {event.verdict}", event.explanation)
        case TaskDefined():
            section = Section("task", json.dumps(event.task, indent=2, ensure_ascii=False))
        case SceneStage():
            files = "\n".join(f"[{kind} {name}]" for kind, name in event.files.items())
            section = Section(f"scene: {event.stage}", files)
        case Rollout():
            moved = f"moved {', '.join(event.moved)}" if event.moved else "moved nothing"
            text = f"{event.steps} steps, doing nothing earns {event.idle_reward:.2f}; {moved}"
            section = Section(f"rollout of seed {event.seed}: {event.outcome}, reward {event.reward:.2f}", text)
        case Finding():
            bound = f"\nasked: {event.bound}" if event.bound else ""
            section = Section(f"audit, {event.check}: {format_finding_verdict(event)}", event.measured + bound)
        case Note():
            section = Section(event.level, event.text)
        case NodeEnded(error=error) if error:
            section = Section("error", error)
        case NodeEnded(values=values) if values:
            lines = [f"{key}: {json.dumps(value, ensure_ascii=False)}" for key, value in values.items()]
            section = Section("state", "\n".join(lines))
        case _:
            section = None
    return section
