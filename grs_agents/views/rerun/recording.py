"""A rerun recording file with the four timelines; nothing is ever sent over a network."""

import shutil
import threading
from collections.abc import Iterable
from copy import copy
from pathlib import Path
from time import monotonic
from typing import Any

import numpy as np
import numpy.typing as npt
import rerun as rr
import rerun.blueprint as rrb

from grs_agents.errors import InputError
from grs_agents.views.rerun.clock import Moment
from grs_agents.views.rerun.rows import Archetype, Rows

APPLICATION = "grs"
LEAST_FREE = 16 * 2**20
"""Bytes that must be free on the disk before an event is recorded."""
SOON, LATER = 0.5, 2.0
"""Seconds that what is recorded may wait for more, where somebody watches and where nobody does: rerun takes as long
for a chunk of one row as of many."""
BETWEEN_CHECKS = 0.2
"""Seconds in which the disk is not looked at again."""


class Recording:
    """Writes archetypes to ``path`` at the moment last set.

    Args:
        path: the ``.rrd`` file; what it held is replaced.
        run_id: two files of one run open as one recording.
        blueprint: how the viewer lays the recording out.
        live: address of a viewer that shows it while it is written, or None.
    """

    def __init__(self, path: Path, run_id: str, blueprint: rrb.Blueprint, live: str | None = None) -> None:
        self.moment = Moment()
        self._path = path
        self._space_checked = -BETWEEN_CHECKS
        self._prefix = ""
        self._clocks: list[tuple[Moment, int] | None] = [None]  # one for all that lie below other paths
        wait = SOON if live else LATER
        together = rr.ChunkBatcherConfig(flush_tick=wait)
        self._stream = rr.RecordingStream(APPLICATION, recording_id=run_id, batcher_config=together)
        if live is None:
            self._stream.save(path, default_blueprint=blueprint)
        else:
            self._stream.set_sinks(rr.FileSink(path), rr.GrpcSink(live), default_blueprint=blueprint)
        self._stream.set_log_time_enabled(False)
        self._stream.set_log_tick_enabled(False)
        self._stream.send_recording_name(run_id)
        self._rows = Rows(self._stream, wait)

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
            self._keep_time()
        self._stream.log(f"{self._prefix}{path}", *archetypes, static=static, strict=True)

    def row(self, path: str, kind: type[Archetype], **values: list[Any]) -> None:
        """Log the components of an archetype at the present moment, together with other rows."""
        self._rows.add(f"{self._prefix}{path}", kind, self.moment, values)

    def text(self, path: str, markdown: str) -> None:
        """Show a document."""
        self.row(path, rr.TextDocument, text=[markdown], media_type=[rr.MediaType.MARKDOWN])

    def _keep_time(self) -> None:
        """Set the clocks, which rerun keeps for each thread, unless they stand right already."""
        now = (self.moment, threading.get_ident())
        if now != self._clocks[0]:
            self._stream.set_time("replay", duration=self.moment.replay)
            self._stream.set_time("event", sequence=self.moment.event)
            self._stream.set_time("attempt", sequence=self.moment.attempt)
            self._stream.set_time("sim_time", duration=self.moment.simulated)
            self._clocks[0] = now

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

    def close(self) -> None:
        """Write what is left and the footer."""
        self._rows.send()
        self._stream.disconnect()
