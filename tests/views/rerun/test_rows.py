"""Small rows of a recording, sent together."""

from contextlib import suppress
from pathlib import Path

import rerun as rr
from rerun.chunk import RrdReader

from grs_agents.views.rerun.recording import Moment, RowBatcher


def test_rows_are_sent_together_each_at_its_moment(tmp_path: Path) -> None:
    stream = rr.RecordingStream("grs", recording_id="a")
    stream.save(tmp_path / "a.rrd")
    rows = RowBatcher(stream, wait=60.0)
    for event in range(3):
        moment = Moment(event / 10, event, attempt=1, simulated=2.0)
        rows.add_row("/seconds", rr.Scalars, moment, {"scalars": [float(event)]})
        rows.add_row("/graph", rr.GraphNodes, moment, {"node_ids": ["a", "b"][: 1 + event % 2]})
    rows.send_pending_rows()
    rows.send_pending_rows()
    stream.disconnect()
    seconds, graph = (
        [chunk.to_record_batch() for chunk in RrdReader(tmp_path / "a.rrd").stream().filter(content=path).to_chunks()]
        for path in ("/seconds", "/graph")
    )
    assert [batch.num_rows for batch in (*seconds, *graph)] == [3, 3]
    assert seconds[0].column("Scalars:scalars").to_pylist() == [[0.0], [1.0], [2.0]]
    assert [moment.total_seconds() for moment in seconds[0].column("replay").to_pylist()] == [0.0, 0.1, 0.2]
    assert [moment.total_seconds() for moment in seconds[0].column("sim_time").to_pylist()] == [2.0] * 3
    assert seconds[0].column("event").to_pylist() == [0, 1, 2]
    assert graph[0].column("GraphNodes:node_ids").to_pylist() == [["a"], ["a", "b"], ["a"]]


def test_a_row_is_sent_though_nothing_follows(tmp_path: Path) -> None:
    stream = rr.RecordingStream("grs", recording_id="a")
    stream.save(tmp_path / "a.rrd")
    RowBatcher(stream, wait=0.1).add_row("/seconds", rr.Scalars, Moment(), {"scalars": [1.0]})
    found = 0
    while not found:
        with suppress(RuntimeError):  # a message is being written
            found = len(RrdReader(tmp_path / "a.rrd").stream().filter(content="/seconds").to_chunks())
    stream.disconnect()
    assert found == 1
