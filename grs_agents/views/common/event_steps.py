"""Events folded into steps (one visit of one node each), and each event as one line: a mark, a phrase and a level."""

from dataclasses import dataclass, field
from typing import Any, Literal

from grs_agents.base.trace.events import (
    Decision,
    Event,
    Finding,
    NodeEnded,
    NodeStarted,
    Note,
    ProgramVersion,
    Prompt,
    Reply,
    Rollout,
    RunEnded,
    RunStarted,
    SceneStage,
    TaskDefined,
    TestsRun,
    ToolCall,
)
from grs_agents.views.common.event_markdown import format_outcome_counts

Status = Literal["running", "done", "failed", "interrupted"]


@dataclass
class Step:
    """One visit of a node."""

    number: int  # from 1, in order
    node: str
    visit: int
    attempt: int
    started: float  # seconds since 1970
    status: Status = "running"  # how it stands; `interrupted` if the run died in it
    seconds: float = 0.0  # wall time once it is done
    input_tokens: int = 0  # of its model calls
    output_tokens: int = 0
    cost: float | None = None  # of its model calls in US dollars; None where no provider told it
    details: list[str] = field(default_factory=list[str])  # what came of it, one phrase each
    events: list[Event] = field(default_factory=list[Event])  # all that happened in it, start and end too

    @property
    def total_tokens(self) -> int:
        """Input and output together."""
        return self.input_tokens + self.output_tokens

    @property
    def model_replies(self) -> list[Reply]:
        """The answers of its models."""
        return [event for event in self.events if isinstance(event, Reply)]

    @property
    def problem_summary(self) -> str:
        """What went wrong in it, in a phrase: its own error, failing tests or checks; empty if nothing did."""
        if self.status in ("failed", "interrupted"):
            return self.details[-1] if self.details else self.status
        problem = ""
        for event in self.events:
            if isinstance(event, TestsRun) and event.report.get("outcome") != "passed":
                problem = f"tests: {summarise_event(event)}"
            elif isinstance(event, Finding) and not event.passed:
                problem = f"{event.check}: {event.detail}"
        return problem

    @property
    def details_as_text(self) -> str:
        """All that came of it, the latest first where one replaces another."""
        return "; ".join(self.details)


class Steps:
    """Folds events, one at a time, into ``rows``."""

    def __init__(self) -> None:
        self.rows: list[Step] = []
        self._steps: dict[int, Step] = {}  # by the sequence of the event that started them
        self.ended: RunEnded | None = None
        self.decision: Decision | None = None

    @property
    def running_step(self) -> Step | None:
        """The step that is running, the one that started last if several are."""
        return next((step for step in reversed(self.rows) if step.status == "running"), None)

    def add_event(self, event: Event) -> None:
        """Take one more event in."""
        if isinstance(event, RunStarted):  # what ran when an earlier attempt died
            self._interrupt_running_steps()
        elif isinstance(event, NodeStarted):
            step = Step(len(self.rows) + 1, event.node, event.visit, event.attempt, event.time)
            step.events.append(event)
            self.rows.append(step)
            self._steps[event.sequence] = step
        elif isinstance(event, NodeEnded):
            self._end_step(event)
        elif isinstance(event, RunEnded):
            self.ended = event
            self._interrupt_running_steps()
        elif step := self._find_step_of_event(event):
            self._add_event_to_step(step, event)

    def _find_step_of_event(self, event: Event) -> Step | None:
        """The step that an event belongs to; of threads that do not say so, the one that runs."""
        return self.running_step if event.step is None else self._steps.get(event.step)

    def _interrupt_running_steps(self) -> None:
        for step in self.rows:
            if step.status == "running":
                step.status = "interrupted"

    def _end_step(self, event: NodeEnded) -> None:
        step = self._find_step_of_event(event)
        if step is not None:
            step.status = "failed" if event.error else "done"
            step.seconds = event.seconds
            step.events.append(event)
            if event.error:
                step.details.append(event.error)

    def _add_event_to_step(self, step: Step, event: Event) -> None:
        step.events.append(event)
        if isinstance(event, Decision):
            self.decision = event
        if isinstance(event, Reply):
            step.input_tokens += event.input_tokens
            step.output_tokens += event.output_tokens
            if event.cost is not None:
                step.cost = (step.cost or 0.0) + event.cost
        text = summarise_event(event)
        if text:
            step.details.append(text)


def summarise_event(event: Event) -> str:
    """What ``event`` adds to a step, as a phrase; empty for events that speak for themselves."""
    match event:
        case SceneStage():
            text = _summarise_scene_stage(event)
        case TaskDefined():
            text = str(event.task.get("task-name") or "")
        case ProgramVersion():
            text = f"{event.program} v{event.number}"
        case TestsRun():
            text = format_outcome_counts(event) or str(event.report.get("outcome"))
        case Decision():
            text = f"→ {event.verdict}: {event.explanation}"
        case Rollout():
            text = f"seed {event.seed}: {event.outcome}, reward {event.reward:.2f}"
        case _:
            text = _summarise_notice(event)
    return text


def _summarise_notice(event: Event) -> str:
    """What went wrong or was asked on the way."""
    match event:
        case Finding(passed=False):
            text = f"{event.check} failed: {event.detail}"
        case Reply(error=error) if error:
            text = f"reply of {event.role} not used: {error}"
        case ToolCall():
            told = (line for line in event.result.splitlines() if not line.startswith("=="))
            text = f"{event.tool}: {next(told, '')[:100]}"
        case Note(level="warning" | "error"):
            text = event.text
        case _:  # it speaks for itself
            text = ""
    return text


def _summarise_scene_stage(event: SceneStage) -> str:
    objects: list[Any] | None = event.summary.get("objects")
    coverage: dict[str, Any] | None = event.summary.get("coverage")
    told = f", coverage {coverage['share']:.2f}" if coverage else ""
    return event.stage if objects is None else f"{event.stage}: {len(objects)} objects{told}"


def group_events_into_steps(events: list[Event]) -> list[Step]:
    """The steps of a whole run."""
    folded = Steps()
    for event in events:
        folded.add_event(event)
    return folded.rows


Level = Literal["DEBUG", "INFO", "WARN", "ERROR"]
_NOTE_LEVELS: dict[str, Level] = {"info": "INFO", "warning": "WARN", "error": "ERROR"}
_BEGIN_AND_END = {"run_started": "●", "run_ended": "●", "node_started": "▶", "node_ended": "■"}
_MARKS = {**_BEGIN_AND_END, "prompt": "→", "reply": "←", "finding": "✓"}


def format_event_line(event: Event) -> str:
    """``event`` in words, after a mark that tells its kind at a glance."""
    return f"{_MARKS.get(event.kind, '•')} {_event_line_text(event)}"


def _event_line_text(event: Event) -> str:
    match event:
        case RunStarted():
            text = f"run {event.run_id} starts"
        case RunEnded():
            text = f"{event.status}: {event.reason}"
        case NodeStarted():
            text = f"{event.node}, visit {event.visit}"
        case NodeEnded():
            text = f"{event.node} {event.seconds:.2f} s {event.error}"
        case Prompt():
            text = f"prompt of {event.role}"
        case Reply():
            text = f"reply of {event.role}, {event.input_tokens + event.output_tokens} tokens {event.error}"
        case Finding(passed=True):
            text = f"{event.check}: {event.detail}"
        case Note():
            text = event.text
        case _:
            text = summarise_event(event)
    return text.rstrip()


def event_log_level(event: Event) -> Level:
    """How much attention ``event`` asks for."""
    if isinstance(event, Note):
        return _NOTE_LEVELS[event.level]
    if isinstance(event, NodeEnded | Prompt | Reply):
        return "ERROR" if isinstance(event, NodeEnded) and event.error else "DEBUG"
    wants_attention = (
        event.kind == "decision"
        or (isinstance(event, Finding) and not event.passed)
        or (isinstance(event, RunEnded) and event.status != "accepted")
    )
    return "WARN" if wants_attention else "INFO"
