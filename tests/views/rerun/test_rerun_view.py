"""The recording, read back and compared with the events."""

import contextlib
import os
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import pytest
from rerun.blueprint import View
from rerun.chunk import RrdReader

from grs_agents.base.trace.events import Decision, Event, NodeStarted, ProgramVersion, Prompt, Reply, Rollout
from grs_agents.base.trace.events import TestsRun as Tested
from grs_agents.base.trace.log import read_events
from grs_agents.library.library import Library
from grs_agents.sim.arms.registry import get_arm
from grs_agents.views.common.event_steps import format_event_line
from grs_agents.views.rerun.recording import Paths
from grs_agents.views.rerun.rerun_view import RerunView, rebuild_rrd_file
from grs_agents.views.rerun.viewer import find_rerun_program, viewer_environment
from grs_agents.views.rerun.viewer_layout import build_run_blueprint
from tests.needs import needs
from tests.slow import SLOW
from tests.views.looking import connected, picture, viewer

Rows = list[tuple[int, Any]]
FOLLOWING = 3
"""Rerun's number for a time line that stands at its latest moment."""


def column(path: Path, entity: str, component: str) -> Rows:
    """Event number and value of every row of a component, in order; static rows left out."""
    return [
        (event, value[0]) for event, value in every_row(path, entity, component) if value and value != ["*Not yet.*"]
    ]


def every_row(path: Path, entity: str, component: str) -> Rows:
    """The same with the rows that take the component away, whose value is empty; a value is a list."""
    rows: Rows = []
    for chunk in RrdReader(path).stream().filter(content=entity).to_chunks():
        batch = chunk.to_record_batch()
        if component in batch.schema.names and "event" in batch.schema.names:
            values = batch.column(component).to_pylist()
            rows.extend(zip(batch.column("event").to_pylist(), values, strict=True))
    return sorted(rows, key=lambda row: row[0])


def entities(path: Path) -> set[str]:
    """Every entity path in the file."""
    return {str(chunk.entity_path) for chunk in RrdReader(path).stream().to_chunks()}


def of(events: list[Event], kind: type[Any]) -> list[Any]:
    """The events of one kind."""
    return [event for event in events if isinstance(event, kind)]


def recording_id(path: Path) -> str:
    """The id of a recording that is being written: read once no message is half in the file."""
    while True:
        with contextlib.suppress(RuntimeError):
            return str(RrdReader(path).recordings()[0].recording_id)


def check_whole(path: Path, events: list[Event]) -> None:
    """Every event, node, program, decision, test run and rollout is in the recording, at its number."""
    log = column(path, Paths.LOG, "TextLog:text")
    assert [number for number, _ in log] == [event.sequence for event in events]
    assert [text.split()[0] for _, text in log] == [format_event_line(event).split()[0] for event in events]
    visited = [(event.sequence, event.node) for event in of(events, NodeStarted)]
    lane = column(path, Paths.NODE, "StateChange:state")
    assert [row for row in lane if row[1] != "end"] == visited
    for program in of(events, ProgramVersion):
        shown = dict(column(path, Paths.SIMULATION, "TextDocument:text"))[program.sequence]
        assert f"version {program.number}" in shown
        assert "class Packing(Task):" in shown
    decisions = dict(column(path, Paths.DECISION, "TextDocument:text"))
    assert all(event.explanation in decisions[event.sequence] for event in of(events, Decision))
    reports = column(path, Paths.REPORT, "TextDocument:text")
    assert [number for number, _ in reports] == [event.sequence for event in of(events, Tested)]
    replies = column(path, Paths.REPLY, "TextDocument:text")
    assert [number for number, _ in replies] == [event.sequence for event in of(events, Reply)]
    rollouts = [(event.sequence, event.reward) for event in of(events, Rollout)]
    assert column(path, f"{Paths.METRICS}/reward", "Scalars:scalars") == rollouts


def verify(path: Path) -> None:
    """``rerun rrd verify`` finds nothing wrong."""
    command = [str(find_rerun_program()), "rrd", "verify", str(path)]
    done = subprocess.run(command, env=viewer_environment(), capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


@pytest.fixture
def watched(script: Callable[[], Any], library: Library) -> Iterator[Callable[[], tuple[Any, RerunView]]]:
    """Opens the log of the run with a view subscribed; what stands for a crash is closed at the end."""
    with ExitStack() as opened:

        def start() -> tuple[Any, RerunView]:
            run = script()
            view = RerunView(run.folder, library)
            opened.callback(view._view.close)
            run.log.subscribe(view)
            return run, view

        yield start


def test_a_recording_holds_every_event(watched: Callable[[], tuple[Any, RerunView]]) -> None:
    run, view = watched()
    run.before_fix()
    run.after_fix()
    view.finish()
    path = run.folder / "trace.rrd"
    check_whole(path, read_events(run.log.path))
    verify(path)
    camera = {f"{Paths.CAMERA}/{name}" for name in ("rgb", "depth", "masks", "boxes")}
    assert camera | {f"{Paths.SCENE}/points", f"{Paths.SCENE}/boxes", Paths.OBJECTS} <= entities(path)
    moved = column(path, f"{Paths.WORLD}/object_0", "Transform3D:translation")
    assert len(moved) > 2 * 90
    assert moved[0][1] != moved[90][1]
    still = column(path, f"{Paths.WORLD}/object_1", "Transform3D:translation")
    assert len(still) <= 4
    meshes = [name for name in entities(path) if name.startswith(f"{Paths.WORLD}/object_0/looks_")]
    assert len(meshes) == len(set(meshes)) > 1
    assert column(path, f"{Paths.WORLD}/robot/link_6", "Transform3D:quaternion")
    assert {f"{Paths.WORLD}/robot/{body}/solid" for body in ("world", *get_arm().link_names)} <= entities(path)
    diff = [text for _, text in column(path, Paths.DIFF, "TextLog:text")]
    assert "+        self.max_steps = 4" in diff
    assert path.stat().st_size < 4 * 2**20


def test_a_resumed_run_ends_in_one_whole_recording(watched: Callable[[], tuple[Any, RerunView]]) -> None:
    run, _ = watched()
    run.before_fix()
    run.log.close()
    run, view = watched()
    run.after_fix()
    assert recording_id(run.folder / "trace.1.rrd") == "sample-run"
    view.finish()
    check_whole(run.folder / "trace.rrd", read_events(run.log.path))
    verify(run.folder / "trace.rrd")
    assert [part.name for part in run.folder.glob("trace*.rrd")] == ["trace.rrd"]


def test_a_resumed_run_without_a_recording_shows_what_went_before(
    script: Callable[[], Any], watched: Callable[[], tuple[Any, RerunView]]
) -> None:
    run = script()
    run.before_fix()
    run.log.close()
    run, view = watched()
    run.after_fix()
    view.finish()
    check_whole(run.folder / "trace.rrd", read_events(run.log.path))


def test_a_recording_is_rebuilt_from_the_events_alone(script: Callable[[], Any], library: Library) -> None:
    run = script()
    run.before_fix()
    run.after_fix()
    path = rebuild_rrd_file(run.folder, library)
    assert path == run.folder / "trace.rrd"
    check_whole(path, read_events(run.log.path))
    verify(path)


def test_no_pane_of_the_models_is_empty_at_the_end(script: Callable[[], Any], library: Library) -> None:
    run = script()
    run.before_fix()
    run.after_fix()
    asked = of(read_events(run.log.path), Prompt)
    assert asked[0].images and not asked[-1].images  # the picture of a prompt stays where the next one has none
    shown = every_row(rebuild_rrd_file(run.folder, library), Paths.IMAGE, "EncodedImage:blob")
    assert [bool(value) for _, value in shown] == [True]


def views_of(part: Any) -> Iterator[Any]:
    """Every view in a container."""
    for child in part.contents:
        if isinstance(child, View):
            yield child
        else:
            yield from views_of(child)


def test_no_pane_is_empty_at_the_first_moment(script: Callable[[], Any], library: Library) -> None:
    run = script()
    run.before_fix()
    path = rebuild_rrd_file(run.folder, library)
    first = min(event for event, _ in every_row(path, Paths.LOG, "TextLog:text"))
    there = {
        str(chunk.entity_path)
        for chunk in RrdReader(path).stream().to_chunks()
        if "event" in (names := (batch := chunk.to_record_batch()).schema.names)
        and first in batch.column("event").to_pylist()
        and any(":" in name and not name.startswith(("Pinhole", "ViewCoordinates")) for name in names)
    }
    shown = {f"{view.name}": view for view in views_of(build_run_blueprint(("read",)).root_container)}
    empty: list[str] = []
    for name, view in shown.items():
        given = view.contents if isinstance(view.contents, list) else [view.contents]
        wanted = [str(one).replace("$origin", str(view.origin)).removesuffix("/**") for one in given if one[0] != "-"]
        if not any(one == want or (one + "/").startswith(f"{want}/") for one in there for want in wanted):
            empty.append(name)
    # these are drawn over the whole of their time line at once, wherever one stands in it
    assert set(empty) <= {"What changed", "Nodes over time", "Reward", "Seconds"} and len(shown) > 18


def test_the_viewer_opens_at_the_end(script: Callable[[], Any], library: Library) -> None:
    run = script()
    run.before_fix()
    run.after_fix()
    reader = RrdReader(rebuild_rrd_file(run.folder, library))
    panel = reader.stream(store=reader.blueprints()[0]).filter(content="/time_panel").to_chunks()
    batches = [chunk.to_record_batch() for chunk in panel]
    name = "TimePanelBlueprint:play_state"
    states = [batch.column(name).to_pylist() for batch in batches if name in batch.schema.names]
    assert states == [[[FOLLOWING]]]


def test_a_missing_file_costs_one_warning_and_nothing_else(watched: Callable[[], tuple[Any, RerunView]]) -> None:
    run, view = watched()
    run.before_fix()
    lost = ProgramVersion(program="tests", number=1, sha256="0", path="history/lost.py")
    with pytest.warns(RuntimeWarning, match=r"RerunView failed.*lost\.py"):
        run.log.append(lost)
    run.after_fix()
    view.finish()
    numbers = [number for number, _ in column(run.folder / "trace.rrd", Paths.LOG, "TextLog:text")]
    assert numbers == list(range(run.log.sequence))


def test_a_killed_run_leaves_both_files_readable(tmp_path: Path) -> None:
    program = """
import contextlib, os, pathlib, signal
from rerun.blueprint import View
from rerun.chunk import RrdReader
from grs_agents.library import Library
from grs_agents.base.trace.events import NodeStarted, Note, RunStarted
from grs_agents.base.trace.log import EventLog
from grs_agents.views.rerun.rerun_view import RerunView
log = EventLog(pathlib.Path("events.jsonl"))
log.subscribe(RerunView(pathlib.Path("."), Library()))
log.append(RunStarted(run_id="killed", graph="router", seed=0))
for visit in range(9):
    log.append(NodeStarted(node="route", visit=visit + 1))
shown = 0
while shown < 19:  # a line for each event, a change of state for each node
    with contextlib.suppress(RuntimeError):  # a message is being written
        chunks = [chunk for chunk in RrdReader("trace.rrd").stream().to_chunks() if not chunk.is_static]
        shown = sum(chunk.num_rows for chunk in chunks if str(chunk.entity_path) in ("/log", "/node"))
os.kill(os.getpid(), signal.SIGKILL)
"""
    environment = {**os.environ, "PYTHONPATH": str(Path(__file__).parents[3])}
    done = subprocess.run([sys.executable, "-c", program], cwd=tmp_path, env=environment, check=False)
    assert done.returncode == -9
    events = read_events(tmp_path / "events.jsonl")
    assert len(events) == 10
    check_whole(tmp_path / "trace.rrd", events)


@SLOW
@needs("vulkan")
def test_a_viewer_shows_the_run_while_it_goes_on(script: Callable[[], Any], library: Library) -> None:
    run = script()
    with viewer() as url:
        view = RerunView(run.folder, library, live=url)
        run.log.subscribe(view)
        run.before_fix()
        client = connected(url)
        image = picture(client, 1.0)
        recordings = client.get_state().recordings
        run.after_fix()
        view.finish()
    assert image.shape == (900, 1600, 3)
    assert image.std() > 10
    assert recordings[0].location.endswith("recording_id=sample-run")
    check_whole(run.folder / "trace.rrd", read_events(run.log.path))
