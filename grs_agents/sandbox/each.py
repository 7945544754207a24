"""Work through many items in as few calls as their failures allow: a crash costs one item, not the rest."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from grs_agents.sandbox.call import CallResult, Limits
from grs_agents.sandbox.host import Sandbox


@dataclass(frozen=True)
class EachResult:
    """What became of each item.

    Attributes:
        ended: item -> the event that the tool reported at its end.
        stopped: item -> the call that ended while the item ran.
        unexpected: events for an item that was not asked for, had not started, or had ended before.
        calls: every call, in order; the last one's value is the tool's own result, if it got that far.
    """

    ended: dict[str, dict[str, Any]]
    stopped: dict[str, CallResult]
    unexpected: tuple[str, ...]
    calls: tuple[CallResult, ...]

    @property
    def last(self) -> CallResult:
        """The last call."""
        return self.calls[-1]


def call_each(
    sandbox: Sandbox,
    tool: str,
    request: dict[str, Any],
    items: Sequence[str],
    limits: Limits,
    hopeless: Callable[[CallResult], bool],
    readable: Sequence[Path] = (),
) -> EachResult:
    """Call ``tool`` with ``{**request, "items": [...]}`` until each item has ended or been stopped.

    The tool reports ``{"item": ..., "phase": "start"}`` and ``{"item": ..., "phase": "end", ...}``. When a call
    ends in the middle of an item, the items after it go to a fresh worker. All calls share one wall limit; after
    a first timeout the rest gets one more, unless ``hopeless(call)`` says that it would hang alike.
    """
    ended: dict[str, dict[str, Any]] = {}
    stopped: dict[str, CallResult] = {}
    unexpected: list[str] = []
    calls: list[CallResult] = []
    pending: list[str] = list(items)
    left, second_chance = limits.wall_seconds, True
    while pending:
        share = limits.model_copy(update={"wall_seconds": left})
        call = sandbox.call(tool, {**request, "items": pending}, share, readable)
        calls.append(call)
        before = len(ended)
        running = _collect(call, pending, ended, unexpected)
        if running is not None:
            stopped[running] = call
        pending = [item for item in items if item not in ended and item not in stopped]
        if call.outcome == "ok" or (running is None and len(ended) == before):
            break
        left -= call.seconds
        if left < 0.05 * limits.wall_seconds or call.outcome in ("timeout", "cpu_limit"):
            if not second_chance or hopeless(call):
                break
            left, second_chance = limits.wall_seconds, False
    return EachResult(ended, stopped, tuple(unexpected), tuple(calls))


def _collect(
    call: CallResult, pending: Sequence[str], ended: dict[str, dict[str, Any]], unexpected: list[str]
) -> str | None:
    """Sort the events of ``call`` into ``ended`` and ``unexpected``; the item that was running at its end."""
    running: str | None = None
    for event in call.events:
        item, phase = event.get("item"), event.get("phase")
        if phase == "start" and isinstance(item, str) and item in pending and item not in ended and not running:
            running = item
        elif phase == "end" and isinstance(item, str) and item == running:
            ended[item] = event
            running = None
        else:
            unexpected.append(f"{phase} of {item}"[:200])
    return running
