"""A real viewer opens a recording and shows what happened."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from grs_agents.base.trace.events import NodeStarted, Rollout
from grs_agents.base.trace.log import read_events
from grs_agents.library.library import Library
from grs_agents.views.rerun.rerun_view import rebuild_rrd_file, record_comparison
from tests.needs import needs
from tests.slow import SLOW
from tests.views.looking import headless, picture


def moment(folder: Path, wanted: Callable[[Any], bool]) -> float:
    """Where on the timeline ``replay`` an event is that fits."""
    from grs_agents.views.rerun.recording import Clock

    clock = Clock()
    for event in read_events(folder / "events.jsonl"):
        now = clock.advance_to_event(event)
        if wanted(event):
            return now.replay
    raise AssertionError("no such event")


@SLOW
@needs("vulkan")
def test_a_headless_viewer_draws_the_run(script: Callable[[], Any], library: Library) -> None:
    run = script()
    run.before_fix()
    run.after_fix()
    rebuild_rrd_file(run.folder, library)
    began = moment(run.folder, lambda event: isinstance(event, NodeStarted))
    played = moment(run.folder, lambda event: isinstance(event, Rollout)) + 2.0
    with headless(run.folder / "trace.rrd") as client:
        state = client.get_state()
        views = {view.name for view in state.views}
        first, later = picture(client, began), picture(client, played)
    assert state.recordings[0].location.endswith("recording_id=sample-run")
    assert {timeline.name for timeline in state.recordings[0].timelines} == {"replay", "event", "attempt", "sim_time"}
    assert {"State machine", "Photo", "Twin, same camera", "Rollout", "What changed", "Test report"} <= views
    assert not [report for view in state.views for report in view.reports]
    assert first.shape == later.shape == (900, 1600, 3)
    assert (np.abs(first.astype(int) - later).max(axis=2) > 40).mean() > 0.02


@needs("vulkan")
def test_two_runs_stand_side_by_side(script: Callable[[], Any], library: Library, tmp_path: Path) -> None:
    run = script()
    run.before_fix()
    run.after_fix()
    both = record_comparison([(run.folder, library), (run.folder, library)], tmp_path / "both.rrd")
    with headless(both) as client:
        origins = {view.origin for view in client.get_state().views}
        image = picture(client, moment(run.folder, lambda event: isinstance(event, Rollout)) + 2.0)
    assert {"/run_1/machine", "/run_2/machine", "/run_1/world", "/run_2/world"} <= origins
    left, right = image[100:700, 10:790].astype(int), image[100:700, 810:1590].astype(int)
    assert left.std() > 10 and abs(left.mean() - right.mean()) < 5
