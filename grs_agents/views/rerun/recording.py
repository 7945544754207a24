"""A rerun recording with four timelines, written to a file or a local viewer. Times come from the events alone, so
live and rebuilt recordings agree. Rows are batched: rerun takes about as long for a single row as for many.
``Paths`` holds the entity paths shared by writers and blueprint."""

import math
import shutil
import threading
from collections.abc import Iterable, Mapping, Sequence
from copy import copy
from dataclasses import dataclass
from pathlib import Path
from time import monotonic
from typing import Any, ClassVar, Protocol

import numpy as np
import numpy.typing as npt
import rerun as rr
import rerun.blueprint as rrb

from grs_agents.base.errors import InputError
from grs_agents.base.trace.events import Event, NodeStarted

EVENT_SECONDS = 0.1
"""Duration of an event on the ``replay`` timeline, s; a node lasts a whole number of seconds, at least 1."""


@dataclass(frozen=True)
class Moment:
    """A point on every timeline."""

    replay: float = 0.0  # seconds of the replay: a second per node, real time in rollouts
    event: int = 0  # sequence number of the event
    attempt: int = 0
    simulated: float = 0.0  # simulated seconds of all rollouts so far


class Clock:
    """Assigns moments to events."""

    def __init__(self) -> None:
        self.now = Moment()

    def advance_to_event(self, event: Event) -> Moment:
        """The moment of ``event``."""
        replay = self.now.replay + EVENT_SECONDS
        if isinstance(event, NodeStarted):
            replay = float(math.ceil(round(replay, 6)))
        self.now = Moment(round(replay, 6), event.sequence, event.attempt, self.now.simulated)
        return self.now

    def advance_by_seconds(self, seconds: float) -> None:
        """Advance by ``seconds`` of a rollout."""
        now = self.now
        self.now = Moment(now.replay + seconds, now.event, now.attempt, now.simulated + seconds)


Values = Mapping[str, list[Any]]
"""The values of each component of a row, lists of equal length."""


class Archetype(Protocol):
    """An archetype of rerun with batched rows."""

    @classmethod
    def columns(cls) -> rr.ComponentColumnList:
        """The component columns of values named by keyword."""
        ...


def build_time_columns(moments: Sequence[Moment]) -> tuple[rr.TimeColumn, ...]:
    """Time columns of the four timelines."""
    return (
        rr.TimeColumn("replay", duration=[moment.replay for moment in moments]),
        rr.TimeColumn("event", sequence=[moment.event for moment in moments]),
        rr.TimeColumn("attempt", sequence=[moment.attempt for moment in moments]),
        rr.TimeColumn("sim_time", duration=[moment.simulated for moment in moments]),
    )


class RowBatcher:
    """Rows that wait at most ``wait`` seconds to be sent to ``stream`` together."""

    def __init__(self, stream: rr.RecordingStream, wait: float) -> None:
        self._stream, self._wait = stream, wait
        self._lock = threading.Lock()
        self._timer: threading.Timer | None = None
        self._pending: dict[tuple[str, type[Archetype]], list[tuple[Moment, Values]]] = {}

    def add_row(self, path: str, kind: type[Archetype], moment: Moment, values: Values) -> None:
        """Queue a row."""
        with self._lock:
            self._pending.setdefault((path, kind), []).append((moment, values))
            if self._timer is None:
                self._timer = threading.Timer(self._wait, self.send_pending_rows)
                self._timer.daemon = True
                self._timer.start()

    def send_pending_rows(self) -> None:
        """Send the queued rows."""
        with self._lock:
            if self._timer:
                self._timer.cancel()
            pending, self._pending, self._timer = self._pending, {}, None
            for (path, kind), rows in pending.items():
                times = build_time_columns([moment for moment, _ in rows])
                values = [values for _, values in rows]
                flat = {name: [value for row in values for value in row[name]] for name in values[0]}
                columns = kind.columns(**flat).partition([len(next(iter(row.values()))) for row in values])
                self._stream.send_columns(path, times, columns, strict=True)


APPLICATION = "grs"
LEAST_FREE = 16 * 2**20
"""Free disk space required before an event is recorded, bytes."""
LIVE_WAIT, FILE_WAIT = 0.5, 2.0
"""Batching delay with and without a live viewer, s: rerun takes as long for a chunk of a single row as of many."""
BETWEEN_CHECKS = 0.2
"""Interval between checks of the free disk space, s."""


class RerunRecording:
    """Writes archetypes at ``moment`` to the file ``path``, and to the viewer at the address ``live``."""

    _open: ClassVar[set[rr.RecordingStream]] = set()
    """Unclosed streams, kept alive to avoid a deadlock in rerun (0.41). Deleting a stream flushes it under a lock of
    rerun and needs Python's; creating another stream waits for that lock while it holds Python's."""

    def __init__(self, path: Path, run_id: str, blueprint: rrb.Blueprint, live: str | None = None) -> None:
        self.moment = Moment()
        self._path = path
        self._space_checked = -BETWEEN_CHECKS
        self._prefix = ""
        self._clocks: list[tuple[Moment, int] | None] = [None]  # shared with the copies of `with_path_prefix`
        self.require_disk_space()  # before the stream exists: if its file cannot be written, it may never close
        wait = LIVE_WAIT if live else FILE_WAIT
        together = rr.ChunkBatcherConfig(flush_tick=wait)
        self._stream = rr.RecordingStream(APPLICATION, recording_id=run_id, batcher_config=together)
        self._open.add(self._stream)
        if live is None:
            self._stream.save(path, default_blueprint=blueprint)
        else:
            self._stream.set_sinks(rr.FileSink(path), rr.GrpcSink(live), default_blueprint=blueprint)
        self._stream.set_log_time_enabled(False)
        self._stream.set_log_tick_enabled(False)
        self._stream.send_recording_name(run_id)
        self._rows = RowBatcher(self._stream, wait)

    def with_path_prefix(self, prefix: str) -> "RerunRecording":
        """A view of the same recording with its own moment and all entities below ``prefix``."""
        prefixed = copy(self)
        prefixed._prefix = prefix
        return prefixed

    def require_disk_space(self) -> None:
        """Raise InputError if the disk is nearly full: rerun may hang on a file that it cannot write."""
        now = monotonic()
        if now < self._space_checked + BETWEEN_CHECKS:
            return
        self._space_checked = now
        free = shutil.disk_usage(self._path.parent).free
        if free < LEAST_FREE:
            raise InputError(f"cannot go on with {self._path}: {free} bytes free on the disk", "free some space")

    def log(self, path: str, *archetypes: rr.AsComponents, static: bool = False) -> None:
        """Log at the present moment, or as static data."""
        now = (self.moment, threading.get_ident())  # rerun keeps the times of each thread
        if not static and now != self._clocks[0]:
            self._stream.set_time("replay", duration=self.moment.replay)
            self._stream.set_time("event", sequence=self.moment.event)
            self._stream.set_time("attempt", sequence=self.moment.attempt)
            self._stream.set_time("sim_time", duration=self.moment.simulated)
            self._clocks[0] = now
        self._stream.log(f"{self._prefix}{path}", *archetypes, static=static, strict=True)

    def log_row(self, path: str, kind: type[Archetype], **values: list[Any]) -> None:
        """Queue the components of an archetype at the present moment."""
        self._rows.add_row(f"{self._prefix}{path}", kind, self.moment, values)

    def log_markdown(self, path: str, markdown: str) -> None:
        """Log a Markdown document."""
        self.log_row(path, rr.TextDocument, text=[markdown], media_type=[rr.MediaType.MARKDOWN])

    def log_columns(self, path: str, seconds: npt.NDArray[np.float64], columns: Iterable[rr.ComponentColumn]) -> None:
        """Log N rows at ``seconds`` (N,) after the present moment."""
        moment, count = self.moment, len(seconds)
        indexes = (
            rr.TimeColumn("replay", duration=moment.replay + seconds),
            rr.TimeColumn("event", sequence=np.full(count, moment.event)),
            rr.TimeColumn("attempt", sequence=np.full(count, moment.attempt)),
            rr.TimeColumn("sim_time", duration=moment.simulated + seconds),
        )
        self._stream.send_columns(f"{self._prefix}{path}", indexes, columns, strict=True)

    def close(self) -> None:
        """Send queued rows and close the file."""
        try:
            self._rows.send_pending_rows()
        finally:
            self._stream.disconnect()
            self._open.discard(self._stream)


class Paths:
    """Entity paths."""

    MACHINE = "/machine"
    NODE = "/node"
    LOG = "/log"
    DECISION = "/decision"
    TASK = "/task"
    PROMPT = "/prompt"
    IMAGE = "/prompt_image"
    REPLY = "/reply"
    SIMULATION = "/program/simulation"
    TESTS = "/program/tests"
    DIFF = "/diff"
    REPORT = "/report"
    OBJECTS = "/objects"
    COVERAGE = "/coverage"
    AUDIT = "/audit"
    METRICS = "/metrics"
    SCENE = "/scene"
    CAMERA = "/scene/camera"
    PHOTO = f"{CAMERA}/rgb"
    DEPTH = f"{CAMERA}/depth"
    TWIN_PICTURE = f"{CAMERA}/twin"
    TWIN = "/scene/twin"
    SURROUNDINGS = "/scene/background"
    WORLD = "/world"
    GRASPS = "/log/grasps"
