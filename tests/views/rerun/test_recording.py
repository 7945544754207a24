"""The file of a recording."""

import gc
import weakref
from pathlib import Path

from grs_agents.views.rerun.recording import RerunRecording
from grs_agents.views.rerun.viewer_layout import build_run_blueprint


def test_a_stream_that_nobody_closed_is_not_deleted(tmp_path: Path) -> None:
    """Rerun deletes an open one with a lock held, for which the making of another may wait for ever."""
    blueprint = build_run_blueprint(("a",))
    left, closed = (RerunRecording(tmp_path / f"{name}.rrd", name, blueprint) for name in ("left", "closed"))
    closed.close()
    streams = [weakref.ref(left._stream), weakref.ref(closed._stream)]
    del left, closed
    gc.collect()
    still, gone = (stream() for stream in streams)
    assert still in RerunRecording._open and gone is None
    still.disconnect()
    RerunRecording._open.remove(still)
