"""The event log: ``events.jsonl``, a line for each event, written before subscribers are called."""

import json
import os
import threading
import time
import warnings
from collections.abc import Callable, Generator
from contextlib import contextmanager, suppress
from contextvars import ContextVar
from pathlib import Path

from pydantic import ValidationError

from grs_agents.base.control_characters import escape_control_chars
from grs_agents.base.errors import InputError
from grs_agents.base.files import flush_written_files, make_folder, unwritable_error
from grs_agents.base.foreign.files import MOST_JSON_BYTES, check_json_limits, read_bytes
from grs_agents.base.trace.events import EVENT, VERSION, Event

Subscriber = Callable[[Event], None]
_QUICK = 0.05
"""Seconds: a faster reply is cheap to repeat, and a flush of the log takes about a tenth of this."""
_step: ContextVar[int | None] = ContextVar("step", default=None)
"""The sequence of the event that started the node which runs in this context: nodes may run side by side."""


def _parse_events(path: Path, data: bytes) -> tuple[list[Event], int]:
    """Parse the events of a log, except a torn last line. Returns: the events, the number of bytes that hold them."""
    lines = data.split(b"\n")
    events: list[Event] = []
    length = 0
    for number, line in enumerate(lines, start=1):
        last = number == len(lines)
        if not line.strip():
            length += 0 if last else len(line) + 1
            continue
        try:
            events.append(EVENT.validate_json(line))
        except ValidationError as error:
            if last:
                return events, length
            raise _make_unreadable_line_error(path, number, line, error) from error
        length += len(line) + (0 if last else 1)
    return events, length


def _make_unreadable_line_error(path: Path, number: int, line: bytes, error: ValidationError) -> InputError:
    """The error for a line that is no event: of a later vocabulary, or damaged."""
    with suppress(ValueError, TypeError, AttributeError, RecursionError, OverflowError):
        version = int(json.loads(line).get("version"))
        if version > VERSION:
            message = f"{path} line {number} is an event of version {version}, and this GRS reads up to {VERSION}"
            return InputError(message, "install a later version of grs-agents")
    reason = error.errors(include_url=False)[0]["msg"]
    return InputError(f"{path} line {number} is not an event: {reason}", "restore the file or start a new run")


def read_events(path: Path) -> list[Event]:
    """The events of ``path``, without a last line torn by a crash. Raises InputError: another line is no event."""
    return _parse_events(path, _read_log_bytes(path))[0]


def _read_log_bytes(path: Path) -> bytes:
    """The bytes of a log, which is untrusted."""
    data = read_bytes(path, "name the folder of a run", MOST_JSON_BYTES)
    check_json_limits(data, path)
    return data


class _SubscriberGuard:
    """Turns the first exception of a subscriber into a warning and drops later exceptions; interrupts go through."""

    def __init__(self, subscriber: Subscriber, event: Event, reported: set[int]) -> None:
        self._subscriber, self._event, self._reported = subscriber, event, reported

    def __enter__(self) -> None:
        return None

    def __exit__(self, _: object, error: BaseException | None, __: object) -> bool:
        if not isinstance(error, Exception):
            return False
        if id(self._subscriber) not in self._reported:
            self._reported.add(id(self._subscriber))
            name = getattr(self._subscriber, "__qualname__", type(self._subscriber).__qualname__)
            reason = escape_control_chars(f"{type(error).__name__}: {error}")
            event = f"event {self._event.sequence} ({self._event.kind})"
            text = f"{name} failed at {event} and may show less than happened: {reason}"
            warnings.warn(text, RuntimeWarning, stacklevel=3)
        return True


class EventLog:
    """Appends events to a file and calls subscribers, in order, from any thread. Opening an existing file repairs a
    torn last line and continues its numbering. Raises InputError: the file cannot be read or written, or holds
    something else."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.attempt = 0
        self.sequence = 0
        self._lock = threading.RLock()
        self._subscribers: list[Subscriber] = []
        self._reported: set[int] = set()
        try:
            make_folder(path.parent)
            self._file = path.open("ab")
            data = _read_log_bytes(self.path)  # numbering goes on after its last whole event
            events, length = _parse_events(self.path, data)
            if length < len(data):
                self._file.truncate(length)
            if length and data[length - 1 : length] != b"\n":
                self._file.write(b"\n")
                self._file.flush()
            if events:
                self.sequence = events[-1].sequence + 1
                self.attempt = events[-1].attempt
        except OSError as error:
            raise unwritable_error(path, error) from error

    def subscribe(self, subscriber: Subscriber) -> None:
        """Call ``subscriber`` with every event from now on, after the event is in the file."""
        self._subscribers.append(subscriber)

    @contextmanager
    def step(self, event: Event) -> Generator[None]:
        """Append ``event``, which starts a node; events that its thread appends in the block belong to it."""
        token = _step.set(self.append(event).sequence)
        try:
            yield
        finally:
            _step.reset(token)

    def append(self, event: Event) -> Event:
        """Stamp ``event`` with sequence, time, attempt and step, write it, call the subscribers, return the copy. A
        failing subscriber is reported once as a warning; the run and the other subscribers go on."""
        with self._lock:
            stamp: dict[str, float | None] = {
                "sequence": self.sequence,
                "time": round(time.time(), 6),
                "attempt": self.attempt,
                "step": _step.get(),
            }
            stamped = event.model_copy(update=stamp)
            try:
                # Work that is not repeated after these events: they must outlast a power cut.
                relied_on = stamped.kind in ("node_ended", "run_ended") or (
                    stamped.kind == "reply" and stamped.seconds > _QUICK
                )
                if relied_on:
                    flush_written_files()  # the files that an event names must exist
                self._file.write(EVENT.dump_json(stamped) + b"\n")
                self._file.flush()
                if relied_on:
                    os.fsync(self._file.fileno())
            except OSError as error:
                raise unwritable_error(self.path, error) from error
            self.sequence += 1
            for subscriber in self._subscribers:
                with _SubscriberGuard(subscriber, stamped, self._reported):
                    subscriber(stamped)
            return stamped

    def close(self) -> None:
        """Close the file; appending is over."""
        self._file.close()

    def __enter__(self) -> "EventLog":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()
