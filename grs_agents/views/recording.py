"""A rerun recording file with the four timelines; nothing is ever sent over a network."""

import shutil
from collections.abc import Iterable
from copy import copy
from pathlib import Path

import numpy as np
import numpy.typing as npt
import rerun as rr
import rerun.blueprint as rrb

from grs_agents.errors import InputError
from grs_agents.views.clock import Moment

APPLICATION = "grs"
LEAST_FREE = 16 * 2**20
"""Bytes that must be free on the disk before an event is recorded."""
FLUSH_SECONDS = 10.0
"""How long the file may take to swallow one event."""


class Recording:
    """Writes archetypes to ``path`` at the moment last set.

    Args:
        path: the ``.rrd`` file; what it held is replaced.
        run_id: two files of one run open as one recording.
        blueprint: how the viewer lays the recording out.
    """

    def __init__(self, path: Path, run_id: str, blueprint: rrb.Blueprint) -> None:
        self.moment = Moment()
        self._path = path
        self._prefix = ""
        self._broken = False
        self._stream = rr.RecordingStream(APPLICATION, recording_id=run_id)
        self._stream.save(path, default_blueprint=blueprint)
        self._stream.set_log_time_enabled(False)
        self._stream.set_log_tick_enabled(False)
        self._stream.send_recording_name(run_id)

    def below(self, prefix: str) -> "Recording":
        """The same recording, in which everything lies below ``prefix``; its moment is its own."""
        other = copy(self)
        other._prefix = prefix
        return other

    def require_space(self) -> None:
        """See that the disk has room for one more event: rerun may wait for ever for a file that it cannot write.

        Raises:
            InputError: less than ``LEAST_FREE`` bytes are free; the recording ends here.
        """
        free = shutil.disk_usage(self._path.parent).free
        if free < LEAST_FREE:
            raise InputError(f"cannot go on with {self._path}: {free} bytes free on the disk", "free some space")

    def log(self, path: str, *archetypes: rr.AsComponents, static: bool = False) -> None:
        """Log at the present moment, or for all time."""
        if not static:  # rerun keeps the time for each thread, so it is set before every call
            self._stream.set_time("replay", duration=self.moment.replay)
            self._stream.set_time("event", sequence=self.moment.event)
            self._stream.set_time("attempt", sequence=self.moment.attempt)
            self._stream.set_time("sim_time", duration=self.moment.simulated)
        self._stream.log(f"{self._prefix}{path}", *archetypes, static=static, strict=True)

    def columns(self, path: str, seconds: npt.NDArray[np.float64], columns: Iterable[rr.ComponentColumn]) -> None:
        """Log one row for each of ``seconds`` (N,) after the present moment; each column has N rows."""
        moment, count = self.moment, len(seconds)
        indexes = (
            rr.TimeColumn("replay", duration=moment.replay + seconds),
            rr.TimeColumn("event", sequence=np.full(count, moment.event)),
            rr.TimeColumn("attempt", sequence=np.full(count, moment.attempt)),
            rr.TimeColumn("sim_time", duration=moment.simulated + seconds),
        )
        self._stream.send_columns(f"{self._prefix}{path}", indexes, columns, strict=True)

    def flush(self) -> None:
        """Put everything logged so far into the file, so that a killed run leaves a readable one.

        Raises:
            RuntimeError: the file cannot be written, e.g. the disk is full; the recording ends there.
        """
        if self._broken:  # rerun would wait for ever for a file that it has given up
            return
        try:
            self._stream.flush(timeout_sec=FLUSH_SECONDS)
        except RuntimeError:
            self._broken = True
            raise

    def close(self) -> None:
        """Write what is left and the footer."""
        self._stream.disconnect()
