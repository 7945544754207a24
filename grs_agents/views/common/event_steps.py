"""Events grouped into steps (visits of nodes), and each event as a line with a mark and a log level."""

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
    """A visit of a node."""

    number: int  # from 1, in order
    node: str
    visit: int
    attempt: int
    started: float  # seconds since 1970
    status: Status = "running"  # `interrupted` if the run died in it
    seconds: float = 0.0  # wall time once it is done
    input_tokens: int = 0  # of its model calls
    output_tokens: int = 0
    cost: float | None = None  # of its model calls in US dollars; None if no provider reports it
    details: list[str] = field(default_factory=list[str])  # a phrase for each result
    events: list[Event] = field(default_factory=list[Event])  # start and end included

    @property
    def total_tokens(self) -> int:
        """Input and output tokens."""
        return self.input_tokens + self.output_tokens

    @property
    def model_replies(self) -> list[Reply]:
        """Replies of its models."""
        return [event for event in self.events if isinstance(event, Reply)]

    @property
    def problem_summary(self) -> str:
        """Its error, or its last failed tests or check, as a phrase; empty without a problem."""
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
        """All details in order."""
        return "; ".join(self.details)


class Steps:
    """Groups events, in order, into the steps ``rows``."""

    def __init__(self) -> None:
        self.rows: list[Step] = []
        self._steps: dict[int, Step] = {}  # by the sequence of the event that started them
        self.ended: RunEnded | None = None
        self.decision: Decision | None = None

    @property
    def running_step(self) -> Step | None:
        """The running step that started last."""
        return next((step for step in reversed(self.rows) if step.status == "running"), None)

    def add_event(self, event: Event) -> None:
        """Add an event to its step."""
        if isinstance(event, RunStarted):  # after a resumption: steps running when the earlier process died
            self._interrupt_running_steps()
        elif isinstance(event, NodeStarted):
            step = Step(len(self.rows) + 1, event.node, event.visit, event.attempt, event.time)
            step.events.append(event)
            self.rows.append(step)
            self._steps[event.sequence] = step
        elif isinstance(event, RunEnded):
            self.ended = event
            self._interrupt_running_steps()
        # events of threads without a step belong to the running step
        elif step := (self.running_step if event.step is None else self._steps.get(event.step)):
            step.events.append(event)
            if isinstance(event, NodeEnded):
                step.status = "failed" if event.error else "done"
                step.seconds = event.seconds
                if event.error:
                    step.details.append(event.error)
                return
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

    def _interrupt_running_steps(self) -> None:
        for step in self.rows:
            if step.status == "running":
                step.status = "interrupted"


def summarise_event(event: Event) -> str:
    """The result that ``event`` adds to a step, as a phrase; empty for events without a result."""
    match event:
        case SceneStage():
            objects: list[Any] | None = event.summary.get("objects")
            coverage: dict[str, Any] | None = event.summary.get("coverage")
            share = f", coverage {coverage['share']:.2f}" if coverage else ""
            text = event.stage if objects is None else f"{event.stage}: {len(objects)} objects{share}"
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
        case Finding(passed=False):
            text = f"{event.check} failed: {event.detail}"
        case Reply(error=error) if error:
            text = f"reply of {event.role} not used: {error}"
        case ToolCall():
            first_line = next((line for line in event.result.splitlines() if not line.startswith("==")), "")
            text = f"{event.tool}: {first_line[:100]}"
        case Note(level="warning" | "error"):
            text = event.text
        case _:
            text = ""
    return text


def group_events_into_steps(events: list[Event]) -> list[Step]:
    """The steps of a whole run."""
    steps = Steps()
    for event in events:
        steps.add_event(event)
    return steps.rows


Level = Literal["DEBUG", "INFO", "WARN", "ERROR"]
_NOTE_LEVELS: dict[str, Level] = {"info": "INFO", "warning": "WARN", "error": "ERROR"}
_BEGIN_AND_END = {"run_started": "●", "run_ended": "●", "node_started": "▶", "node_ended": "■"}
_MARKS = {**_BEGIN_AND_END, "prompt": "→", "reply": "←", "finding": "✓"}


def format_event_line(event: Event) -> str:
    """``event`` as a line of text that begins with a mark of its kind."""
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
    mark = "×" if isinstance(event, Finding) and not event.passed else _MARKS.get(event.kind, "•")
    return f"{mark} {text.rstrip()}"


def event_log_level(event: Event) -> Level:
    """Log level of ``event``."""
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
