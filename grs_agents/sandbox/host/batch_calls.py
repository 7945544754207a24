"""Work through many items in as few calls as their failures allow: a crash costs a single item, not the rest."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from grs_agents.sandbox.host.sandbox import Sandbox
from grs_agents.sandbox.protocol.report import CallResult, Limits


@dataclass(frozen=True)
class BatchResult:
    """Outcomes of all items."""

    ended: dict[str, dict[str, Any]]  # item -> the event that the tool reported at its end
    stopped: dict[str, CallResult]  # item -> the call that ended while the item ran
    repeated: frozenset[str]  # items that started or ended a second time
    strange: tuple[str, ...]  # events for an item that was not asked for
    untimely: frozenset[str]  # items whose end was reported while they were not running
    # every call, in order; the value of the last is the tool's own result, if it got that far
    calls: tuple[CallResult, ...]

    @property
    def last_call(self) -> CallResult:
        """The last call."""
        return self.calls[-1]


def call_tool_for_each_item(
    sandbox: Sandbox,
    tool: str,
    request: dict[str, Any],
    items: Sequence[str],
    limits: Limits,
    hopeless: Callable[[CallResult], bool],
    readable: Sequence[Path] = (),
) -> BatchResult:
    """Call ``tool`` with ``{**request, "items": [...]}`` until each item has ended or been stopped.

    The tool reports ``{"item": ..., "phase": "start"}`` and ``{"item": ..., "phase": "end", ...}``. When a call ends in
    the middle of an item, the items after it go to a fresh worker. All calls share a wall limit; after a first timeout
    the rest gets a second limit, unless ``hopeless(call)`` says that it would hang alike.
    """
    events, calls = _Events(tuple(items)), list[CallResult]()
    pending: list[str] = list(items)
    left, second_chance = limits.wall_seconds, True
    while pending:
        share = limits.model_copy(update={"wall_seconds": left})
        call = sandbox.call(tool, {**request, "items": pending}, share, readable)
        calls.append(call)
        before = len(events.ended)
        running = events.sort_events_of_call(call)
        pending = [item for item in items if item not in events.ended and item not in events.stopped]
        if call.outcome == "ok" or (running is None and len(events.ended) == before):
            break
        left -= call.seconds
        if left < 0.05 * limits.wall_seconds or call.outcome in ("timeout", "cpu_limit"):
            if not second_chance or hopeless(call):
                break
            left, second_chance = limits.wall_seconds, False
    strange = tuple(dict.fromkeys(events.strange))
    repeated, untimely = frozenset(events.repeated), frozenset(events.untimely)
    return BatchResult(events.ended, events.stopped, repeated, strange, untimely, tuple(calls))


@dataclass
class _Events:
    """Events of all calls so far."""

    items: tuple[str, ...]
    ended: dict[str, dict[str, Any]] = field(default_factory=dict[str, dict[str, Any]])
    stopped: dict[str, CallResult] = field(default_factory=dict[str, CallResult])
    repeated: set[str] = field(default_factory=set[str])
    strange: list[str] = field(default_factory=list[str])
    untimely: set[str] = field(default_factory=set[str])

    def sort_events_of_call(self, call: CallResult) -> str | None:
        """Sort the events of ``call``; the item that was running at its end."""
        running: str | None = None
        for event in call.events:
            item, phase = event.get("item"), event.get("phase")
            if not (isinstance(item, str) and item in self.items and phase in ("start", "end")):
                self.strange.append(str(item)[:200])
            elif item in self.ended or item in self.stopped or (phase == "start" and item == running):
                self.repeated.add(item)
            elif phase == "start" and running is None:
                running = item
            elif phase == "end" and item == running:
                self.ended[item] = event
                running = None
            else:
                self.untimely.add(item)
        if running is not None:
            self.stopped[running] = call
        return running
