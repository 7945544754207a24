"""A rerun recording file with the four timelines; nothing is ever sent over a network.
Times come from the events alone, so that a live and a rebuilt recording agree. Small rows are sent together: rerun
takes about as long for one row as for many. The blueprint and the writers agree on the names of entities here."""

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
"""Seconds of ``replay`` between two events inside a node; a node takes whole seconds, at least one."""


@dataclass(frozen=True)
class Moment:
    """One instant on every timeline."""

    replay: float = 0.0  # seconds into the film of the run: a second a node, real seconds inside rollouts
    event: int = 0  # sequence number of the event
    attempt: int = 0
    simulated: float = 0.0  # simulated seconds of all rollouts so far


class Clock:
    """Turns events into moments."""

    def __init__(self) -> None:
        self.now = Moment()

    def advance_to_event(self, event: Event) -> Moment:
        """The moment at which ``event`` is shown."""
        replay = self.now.replay + EVENT_SECONDS
        if isinstance(event, NodeStarted):
            replay = float(math.ceil(round(replay, 6)))
        self.now = Moment(round(replay, 6), event.sequence, event.attempt, self.now.simulated)
        return self.now

    def advance_by_seconds(self, seconds: float) -> None:
        """Let ``seconds`` of a rollout go by."""
        now = self.now
        self.now = Moment(now.replay + seconds, now.event, now.attempt, now.simulated + seconds)


Values = Mapping[str, list[Any]]
"""What each component of a row holds; all lists are of one length."""


class Archetype(Protocol):
    """An archetype of rerun of which many rows can be sent at once."""

    @classmethod
    def columns(cls) -> rr.ComponentColumnList:
        """The values of each of its components, named by keyword, one after the other."""
        ...


def build_time_columns(moments: Sequence[Moment]) -> tuple[rr.TimeColumn, ...]:
    """Where rows stand on the four timelines."""
    return (
        rr.TimeColumn("replay", duration=[moment.replay for moment in moments]),
        rr.TimeColumn("event", sequence=[moment.event for moment in moments]),
        rr.TimeColumn("attempt", sequence=[moment.attempt for moment in moments]),
        rr.TimeColumn("sim_time", duration=[moment.simulated for moment in moments]),
    )


class Rows:
    """Rows that wait to be sent to ``stream``, for ``wait`` seconds at most, whatever happens meanwhile."""

    def __init__(self, stream: rr.RecordingStream, wait: float) -> None:
        self._stream, self._wait = stream, wait
        self._lock = threading.Lock()
        self._timer: threading.Timer | None = None
        self._waiting: dict[tuple[str, type[Archetype]], list[tuple[Moment, Values]]] = {}

    def add_row(self, path: str, kind: type[Archetype], moment: Moment, values: Values) -> None:
        """Send a row soon."""
        with self._lock:
            self._waiting.setdefault((path, kind), []).append((moment, values))
            if self._timer is None:
                self._timer = threading.Timer(self._wait, self.send_pending_rows)
                self._timer.daemon = True
                self._timer.start()

    def send_pending_rows(self) -> None:
        """Send what waits."""
        with self._lock:
            if self._timer:
                self._timer.cancel()
            waiting, self._waiting, self._timer = self._waiting, {}, None
            for (path, kind), rows in waiting.items():
                times = build_time_columns([moment for moment, _ in rows])
                columns = _merge_rows_into_columns(kind, [values for _, values in rows])
                self._stream.send_columns(path, times, columns, strict=True)


def _merge_rows_into_columns(kind: type[Archetype], rows: list[Values]) -> rr.ComponentColumnList:
    """The components of ``rows``, each as one column."""
    flat = {name: [value for row in rows for value in row[name]] for name in rows[0]}
    return kind.columns(**flat).partition([len(next(iter(row.values()))) for row in rows])


APPLICATION = "grs"
LEAST_FREE = 16 * 2**20
"""Bytes that must be free on the disk before an event is recorded."""
LIVE_WAIT, FILE_WAIT = 0.5, 2.0
"""Seconds that what is recorded may wait for more, where somebody watches and where nobody does: rerun takes as long
for a chunk of one row as of many."""
BETWEEN_CHECKS = 0.2
"""Seconds in which the disk is not looked at again."""


class Recording:
    """Writes archetypes to ``path`` (and to the viewer at the address ``live``) at the moment last set."""

    _open: ClassVar[set[rr.RecordingStream]] = set()
    """Streams that are not closed. Were one deleted, rerun (0.41) would flush it with a lock held for which the making
    of another waits without letting go of Python's, which the flush needs in turn: both wait for ever. So none is."""

    def __init__(self, path: Path, run_id: str, blueprint: rrb.Blueprint, live: str | None = None) -> None:
        self.moment = Moment()
        self._path = path
        self._space_checked = -BETWEEN_CHECKS
        self._prefix = ""
        self._clocks: list[tuple[Moment, int] | None] = [None]  # one for all that lie below other paths
        self.require_disk_space()  # before there is a stream: one whose file cannot be written may never close
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
        self._rows = Rows(self._stream, wait)

    def with_path_prefix(self, prefix: str) -> "Recording":
        """The same recording, in which everything lies below ``prefix``; its moment is its own."""
        other = copy(self)
        other._prefix = prefix
        return other

    def require_disk_space(self) -> None:
        """See that the disk has room for one more event: rerun may wait for ever for a file that it cannot write."""
        now = monotonic()
        if now < self._space_checked + BETWEEN_CHECKS:
            return
        self._space_checked = now
        free = shutil.disk_usage(self._path.parent).free
        if free < LEAST_FREE:
            raise InputError(f"cannot go on with {self._path}: {free} bytes free on the disk", "free some space")

    def log(self, path: str, *archetypes: rr.AsComponents, static: bool = False) -> None:
        """Log at the present moment, or for all time."""
        if not static:
            self._set_stream_time()
        self._stream.log(f"{self._prefix}{path}", *archetypes, static=static, strict=True)

    def log_row(self, path: str, kind: type[Archetype], **values: list[Any]) -> None:
        """Log the components of an archetype at the present moment, together with other rows."""
        self._rows.add_row(f"{self._prefix}{path}", kind, self.moment, values)

    def log_markdown(self, path: str, markdown: str) -> None:
        """Show a document."""
        self.log_row(path, rr.TextDocument, text=[markdown], media_type=[rr.MediaType.MARKDOWN])

    def _set_stream_time(self) -> None:
        """Set the clocks, which rerun keeps for each thread, unless they stand right already."""
        now = (self.moment, threading.get_ident())
        if now != self._clocks[0]:
            self._stream.set_time("replay", duration=self.moment.replay)
            self._stream.set_time("event", sequence=self.moment.event)
            self._stream.set_time("attempt", sequence=self.moment.attempt)
            self._stream.set_time("sim_time", duration=self.moment.simulated)
            self._clocks[0] = now

    def log_columns(self, path: str, seconds: npt.NDArray[np.float64], columns: Iterable[rr.ComponentColumn]) -> None:
        """Log one row for each of ``seconds`` (N,) after the present moment; each column has N rows."""
        moment, count = self.moment, len(seconds)
        indexes = (
            rr.TimeColumn("replay", duration=moment.replay + seconds),
            rr.TimeColumn("event", sequence=np.full(count, moment.event)),
            rr.TimeColumn("attempt", sequence=np.full(count, moment.attempt)),
            rr.TimeColumn("sim_time", duration=moment.simulated + seconds),
        )
        self._stream.send_columns(f"{self._prefix}{path}", indexes, columns, strict=True)

    def close(self) -> None:
        """Write what is left and the footer."""
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
