"""Small rows of a recording, sent together: rerun takes about as long for one row as for many."""

import threading
from collections.abc import Mapping, Sequence
from typing import Any, Protocol

import rerun as rr

from grs_agents.views.rerun.clock import Moment

Values = Mapping[str, list[Any]]
"""What each component of a row holds; all lists are of one length."""


class Archetype(Protocol):
    """An archetype of rerun of which many rows can be sent at once."""

    @classmethod
    def columns(cls) -> rr.ComponentColumnList:
        """The values of each of its components, named by keyword, one after the other."""
        ...


def time_columns(moments: Sequence[Moment]) -> tuple[rr.TimeColumn, ...]:
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

    def add(self, path: str, kind: type[Archetype], moment: Moment, values: Values) -> None:
        """Send a row soon.

        Args:
            path: the entity.
            kind: the archetype; the rows of one path name the same components.
            moment: the time.
            values: of its components.
        """
        with self._lock:
            self._waiting.setdefault((path, kind), []).append((moment, values))
            if self._timer is None:
                self._timer = threading.Timer(self._wait, self.send)
                self._timer.daemon = True
                self._timer.start()

    def send(self) -> None:
        """Send what waits."""
        with self._lock:
            if self._timer:
                self._timer.cancel()
            waiting, self._waiting, self._timer = self._waiting, {}, None
            for (path, kind), rows in waiting.items():
                self._stream.send_columns(path, time_columns([moment for moment, _ in rows]),
                                          _columns(kind, [values for _, values in rows]), strict=True)  # fmt: skip


def _columns(kind: type[Archetype], rows: list[Values]) -> rr.ComponentColumnList:
    """The components of ``rows``, each as one column."""
    flat = {name: [value for row in rows for value in row[name]] for name in rows[0]}
    return kind.columns(**flat).partition([len(next(iter(row.values()))) for row in rows])
