"""The event log: ``events.jsonl``, one event a line, written before anybody is told."""

import json
import os
import threading
import time
import warnings
from collections.abc import Callable, Generator
from contextlib import contextmanager, suppress
from contextvars import ContextVar
from functools import partial
from pathlib import Path
from typing import BinaryIO

from pydantic import ValidationError

from grs_agents.base.errors import InputError
from grs_agents.base.files import flush_written_files, make_folder, unwritable_error
from grs_agents.base.foreign.files import MOST_JSON_BYTES, check_json_limits, read_bytes
from grs_agents.base.terminal.control_characters import escape_control_chars
from grs_agents.base.trace.events import EVENT, VERSION, Event

Subscriber = Callable[[Event], None]
_QUICK = 0.05
"""Seconds; a reply that came quicker is had again as quickly, and to flush the log takes about a tenth of that."""
_step: ContextVar[int | None] = ContextVar("step", default=None)
"""The sequence of the event that started the node which runs in this context: nodes may run side by side."""


def _parse_events(path: Path, data: bytes) -> tuple[list[Event], int]:
    """The events in ``data`` and how many of its bytes hold whole events (a torn last line is left out)."""
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
    """Why a line is no event: of a later vocabulary than ours, or damaged."""
    with suppress(ValueError, TypeError, AttributeError, RecursionError):
        version = int(json.loads(line).get("version"))
        if version > VERSION:
            found = f"{path} line {number} is an event of version {version}, and this GRS reads up to {VERSION}"
            return InputError(found, "install a later version of grs-agents")
    reason = error.errors(include_url=False)[0]["msg"]
    return InputError(f"{path} line {number} is not an event: {reason}", "restore the file or start a new run")


def read_events(path: Path) -> list[Event]:
    """The events of ``path``, without a last line torn by a crash. Raises InputError: another line is no event."""
    return _parse_events(path, _read_log_bytes(path))[0]


def _read_log_bytes(path: Path) -> bytes:
    """The bytes of a log; its lines may have been written by anybody."""
    data = read_bytes(path, "name the folder of a run", MOST_JSON_BYTES)
    check_json_limits(data, path)
    return data


def _is_relied_on(event: Event) -> bool:
    """Whether an event, with those before it, is to outlast a power cut: what it tells of is not done again."""
    return event.kind in ("node_ended", "run_ended") or (event.kind == "reply" and event.seconds > _QUICK)


class _ReportingExceptions:
    """Hands an exception of its block to ``report`` instead of raising it; interrupts go through."""

    def __init__(self, report: Callable[[Exception], None]) -> None:
        self._report = report

    def __enter__(self) -> None:
        return None

    def __exit__(self, _: object, error: BaseException | None, __: object) -> bool:
        if isinstance(error, Exception):
            self._report(error)
        return isinstance(error, Exception)


class EventLog:
    """Appends events to a file and tells subscribers, in order, whichever thread they come from.
    Opening an existing file repairs a torn last line and goes on counting where it ended.
    Raises InputError: the file cannot be read or written, or holds something else."""

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
            self._resume_numbering(self._file)
        except OSError as error:
            raise unwritable_error(path, error) from error

    def _resume_numbering(self, file: BinaryIO) -> None:
        """Take up numbering from what the file holds, cutting a torn end off and closing an unclosed line."""
        data = _read_log_bytes(self.path)
        events, length = _parse_events(self.path, data)
        if length < len(data):
            file.truncate(length)
        if length and data[length - 1 : length] != b"\n":
            file.write(b"\n")
            file.flush()
        if events:
            self.sequence = events[-1].sequence + 1
            self.attempt = events[-1].attempt

    def subscribe(self, subscriber: Subscriber) -> None:
        """Call ``subscriber`` with every event from now on, after the event is in the file."""
        self._subscribers.append(subscriber)

    @contextmanager
    def step(self, event: Event) -> Generator[None]:
        """Append ``event``, which starts a node; what its thread appends until the block ends belongs to it."""
        token = _step.set(self.append(event).sequence)
        try:
            yield
        finally:
            _step.reset(token)

    def append(self, event: Event) -> Event:
        """Stamp ``event`` with sequence, time, attempt and step, write it, tell the subscribers, return the copy.
        A subscriber that fails is reported once as a warning; the run and the other subscribers go on."""
        with self._lock:
            stamp: dict[str, float | None] = {
                "sequence": self.sequence,
                "time": round(time.time(), 6),
                "attempt": self.attempt,
                "step": _step.get(),
            }
            stamped = event.model_copy(update=stamp)
            try:
                relied_on = _is_relied_on(stamped)
                if relied_on:
                    flush_written_files()  # an event of files says that they are there
                self._file.write(EVENT.dump_json(stamped) + b"\n")
                self._file.flush()
                if relied_on:
                    os.fsync(self._file.fileno())
            except OSError as error:
                raise unwritable_error(self.path, error) from error
            self.sequence += 1
            for subscriber in self._subscribers:
                with _ReportingExceptions(partial(self._warn_subscriber_failed, subscriber, stamped)):
                    subscriber(stamped)
            return stamped

    def _warn_subscriber_failed(self, subscriber: Subscriber, event: Event, error: Exception) -> None:
        """Warn of a failing subscriber, the first time it fails."""
        if id(subscriber) not in self._reported:
            self._reported.add(id(subscriber))
            name = getattr(subscriber, "__qualname__", type(subscriber).__qualname__)
            said = escape_control_chars(f"{type(error).__name__}: {error}")
            text = f"{name} failed at event {event.sequence} ({event.kind}) and may show less than happened: {said}"
            warnings.warn(text, RuntimeWarning, stacklevel=4)

    def close(self) -> None:
        """Close the file; appending is over."""
        self._file.close()

    def __enter__(self) -> "EventLog":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()
