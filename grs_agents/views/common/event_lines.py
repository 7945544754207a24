"""Each event as one line: a mark, a phrase and a level."""

from typing import Literal

from grs_agents.trace import Event, Finding, NodeEnded, NodeStarted, Note, Prompt, Reply, RunEnded, RunStarted
from grs_agents.views.common.steps import phrase

Level = Literal["DEBUG", "INFO", "WARN", "ERROR"]
_NOTE_LEVELS: dict[str, Level] = {"info": "INFO", "warning": "WARN", "error": "ERROR"}
_MARKS = {
    "run_started": "●", "run_ended": "●", "node_started": "▶", "node_ended": "■", "prompt": "→", "reply": "←",
    "finding": "✓",
}  # fmt: skip


def line(event: Event) -> str:
    """``event`` in words, after a mark that tells its kind at a glance."""
    return f"{_MARKS.get(event.kind, '•')} {_words(event)}"


def _words(event: Event) -> str:
    text = ""
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
            text = phrase(event)
    return text.rstrip()


def level(event: Event) -> Level:
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
