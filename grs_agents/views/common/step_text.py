"""One step in full: the exact prompts, replies, diffs and tracebacks of a visit of a node, as plain text."""

import json
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

from grs_agents.errors import InputError
from grs_agents.trace import (
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
)
from grs_agents.views.common.event_documents import cases_of, count_cases
from grs_agents.views.common.steps import Step


@dataclass(frozen=True)
class Section:
    """A heading and the text below it."""

    heading: str
    text: str = ""


def find_step(rows: list[Step], number: int) -> Step:
    """The step called ``number``.

    Raises:
        InputError: the run has no such step.
    """
    if not 1 <= number <= len(rows):
        raise InputError(f"the run has no step {number}", f"name one of 1 to {len(rows)}" if rows else "it has none")
    return rows[number - 1]


def failed_step(rows: list[Step]) -> Step | None:
    """The last step in which something went wrong; None if nothing did."""
    return next((step for step in reversed(rows) if step.trouble), None)


def sections(step: Step) -> Iterator[Section]:
    """All that happened in ``step``, in order."""
    for event in step.events:
        section = _section(event)
        if section:
            yield section


def _section(event: Event) -> Section | None:
    match event:
        case Prompt():
            pictures = "".join(f"\n[picture {name}]" for name in event.images)
            found = Section(f"prompt of {event.role} to {event.model} (call {event.call})", event.text + pictures)
        case Reply():
            found = Section(_reply_heading(event), event.text + (f"\n\nnot used: {event.error}" if event.error else ""))
        case ProgramVersion():
            found = Section(f"{event.program} version {event.number}, {event.path}", event.diff)
        case TestsRun():
            found = Section(f"tests: {event.report.get('outcome')}", _tests(event))
        case Decision():
            found = Section(f"decision of policy {event.policy}: {event.verdict}", event.explanation)
        case TaskDefined():
            found = Section("task", json.dumps(event.task, indent=2, ensure_ascii=False))
        case SceneStage():
            files = "\n".join(f"[{kind} {name}]" for kind, name in event.files.items())
            found = Section(f"scene: {event.stage}", files)
        case Rollout():
            moved = f"moved {', '.join(event.moved)}" if event.moved else "moved nothing"
            text = f"{event.steps} steps, doing nothing earns {event.idle_reward:.2f}; {moved}"
            found = Section(f"rollout of seed {event.seed}: {event.outcome}, reward {event.reward:.2f}", text)
        case Finding():
            found = Section(f"audit, {event.check}: {'passed' if event.passed else 'failed'}", event.detail)
        case Note():
            found = Section(event.level, event.text)
        case NodeEnded():
            found = _ending(event)
        case _:
            found = None
    return found


def _ending(event: NodeEnded) -> Section | None:
    """What the node made of the state, or the error that ended it."""
    if event.error:
        return Section("error", event.error)
    lines = [f"{key}: {json.dumps(value, ensure_ascii=False)}" for key, value in event.values.items()]
    return Section("state", "\n".join(lines)) if lines else None


def _reply_heading(event: Reply) -> str:
    cached = f" ({event.cached_tokens} from the cache)" if event.cached_tokens else ""
    cost = "" if event.cost is None else f", ${event.cost:.4f}"
    ending = f", {event.finish_reason}" if event.finish_reason else ""
    spent = f"{event.input_tokens} tokens in{cached}, {event.output_tokens} out{cost}, {event.seconds:.1f} s{ending}"
    return f"reply of {event.model} to {event.role} (call {event.call}): {spent}"


def _tests(event: TestsRun) -> str:
    cases = cases_of(event)
    summary = ", ".join(f"{number} {outcome}" for outcome, number in count_cases(cases).items())
    parts = [summary, str(event.report.get("message") or "")]
    parts.extend(_case(case) for case in cases)
    return "\n\n".join(part for part in parts if part)


def _case(case: dict[str, Any]) -> str:
    message = f": {case['message']}" if case.get("message") else ""
    lines = [f"{case.get('id')}: {case.get('outcome')} in {case.get('seconds') or 0:.2f} s{message}"]
    for key in ("traceback", "output"):
        if case.get(key):
            lines.append(str(case[key]).rstrip())
    episode: dict[str, Any] = case.get("episode") or {}
    if episode:
        lines.append(f"oracle: {episode.get('outcome')}, reward {episode.get('reward')}: {episode.get('detail')}")
    return "\n".join(lines)
