"""The state machine in the recording."""

from pathlib import Path

from rerun.chunk import RrdReader

from grs_agents.base.trace.events import NodeStarted, RunEnded, RunStarted
from grs_agents.views.rerun.recording import Moment, Paths, RerunRecording
from grs_agents.views.rerun.state_machine_view import MachineView
from grs_agents.views.rerun.viewer_layout import build_run_blueprint


def test_the_graph_of_the_run_is_shown_with_visits(tmp_path: Path) -> None:
    view = MachineView()
    edges = (("__start__", "route"), ("route", "mine"), ("mine", "__end__"))
    nodes = ("__start__", "route", "mine", "__end__")
    view.track_event(RunStarted(run_id="a", graph="mine", seed=0, nodes=nodes, edges=edges))
    view.track_event(NodeStarted(node="route", visit=1))
    view.track_event(NodeStarted(node="route", visit=2))
    assert view.nodes == ("route", "mine", "end")
    recording = RerunRecording(tmp_path / "a.rrd", "a", build_run_blueprint(view.nodes))
    view.log_static_graph(recording)
    view.log_current_state(recording)
    view.track_event(NodeStarted(node="mine", visit=1))
    view.track_event(RunEnded(status="accepted"))
    recording.moment = Moment(event=1)
    view.log_current_state(recording)
    recording.close()
    labels: list[tuple[int, list[str]]] = []
    for chunk in RrdReader(tmp_path / "a.rrd").stream().filter(content=Paths.MACHINE).to_chunks():
        batch = chunk.to_record_batch()
        if "GraphNodes:labels" in batch.schema.names:
            shown = batch.column("GraphNodes:labels").to_pylist()
            labels += zip(batch.column("event").to_pylist(), shown, strict=True)
        else:
            drawn = batch.column("GraphEdges:edges").to_pylist()[0]
            assert [tuple(edge.values()) for edge in drawn] == [("route", "mine"), ("mine", "end")]
    assert sorted(labels) == [(0, ["● route ×2", "mine", "end"]), (1, ["route ×2", "mine ×1", "● end", "1×", "1×"])]
