"""The rerun recording of a run, written as ``trace.rrd`` during the run by a subscriber of the event log."""

from collections.abc import Sequence
from contextlib import ExitStack, closing
from itertools import count
from pathlib import Path

import numpy as np
import rerun as rr

from grs_agents.base.foreign.files import read_bytes
from grs_agents.base.foreign.run_folder import resolve_member_file
from grs_agents.base.trace.events import (
    Decision,
    Event,
    Finding,
    NodeEnded,
    NodeStarted,
    ProgramVersion,
    Prompt,
    Reply,
    Rollout,
    RunEnded,
    RunStarted,
    SceneStage,
    TaskDefined,
    TestsRun,
    ToolCall,
)
from grs_agents.base.trace.log import read_events
from grs_agents.library.library import Library
from grs_agents.views.common import event_markdown
from grs_agents.views.common.event_steps import event_log_level, format_event_line
from grs_agents.views.common.safe_text import replace_undrawable_chars
from grs_agents.views.rerun.recording import Clock, Paths, RerunRecording
from grs_agents.views.rerun.rollout_view import RolloutView, rollout_duration
from grs_agents.views.rerun.scene_view import SceneStageView, log_picture
from grs_agents.views.rerun.state_machine_view import MachineView
from grs_agents.views.rerun.viewer_layout import build_comparison_blueprint, build_run_blueprint
from grs_agents.views.rerun.waiting import NOT_YET, clear_placeholder, log_placeholders

TRACE = "trace.rrd"
_COLORS = {"+": (30, 150, 70), "-": (215, 70, 70), "@": (60, 130, 230)}
_GREY, _VIOLET = (125, 125, 132), (150, 100, 215)
"""Legible on light and dark backgrounds."""
_DOCUMENTS = (Paths.DECISION, Paths.TASK, Paths.OBJECTS, Paths.AUDIT, Paths.SIMULATION, Paths.TESTS, Paths.REPORT)
_MAX_DIFF_LINES = 400
_STEPS = rr.components.InterpolationMode.StepAfter


def log_program_version(recording: RerunRecording, folder: Path, event: ProgramVersion) -> None:
    """Log a program version: its file as a document, its diff as coloured lines."""
    path = Paths.SIMULATION if event.program == "simulation" else Paths.TESTS
    source = read_bytes(resolve_member_file(folder, event.path)).decode("utf-8", "replace")
    recording.log_markdown(path, event_markdown.format_program(event, source))
    head = f"{event.program} version {event.number}" + (f" by {event.author_role}" if event.author_role else "")
    if event.parent is None or not event.diff:
        diff = [f"  {len(source.splitlines())} lines, new"]
    else:
        diff = [line for line in event.diff.splitlines() if not line.startswith(("---", "+++"))]
        if len(diff) > _MAX_DIFF_LINES:
            diff = [*diff[:_MAX_DIFF_LINES], f"  ... {len(diff) - _MAX_DIFF_LINES} more lines"]
    lines = [head, *diff]
    text = [replace_undrawable_chars(line) for line in lines]
    color = [_VIOLET, *(_COLORS.get(line[:1], _GREY) for line in lines[1:])]
    columns = rr.TextLog.columns(text=text, level=["INFO"] * len(lines), color=color)
    recording.log_columns(Paths.DIFF, np.zeros(len(lines)), columns)


class EventView:
    """Writes events to the file ``to``, created with the first event, or into a recording, which is not closed here."""

    def __init__(self, folder: Path, library: Library, to: Path | RerunRecording, live: str | None = None) -> None:
        self._folder, self._to, self._live = folder, to, live
        self._run_id = folder.name
        self._clock = Clock()
        self._machine = MachineView()
        self._scene = SceneStageView(folder, library)
        self._rollouts = RolloutView(folder, library)
        self._tokens = 0
        self._picture: str | None = None
        self._findings: list[Finding] = []
        self._recording: RerunRecording | None = None

    def track_event_without_logging(self, event: Event) -> None:
        """Update the state by an event that an earlier part of the recording shows."""
        self._remember_event_context(event)
        self._clock.advance_to_event(event)
        if isinstance(event, Rollout):
            self._clock.advance_by_seconds(rollout_duration(self._folder, event))

    def write_event(self, event: Event) -> None:
        """Log ``event``."""
        self._remember_event_context(event)
        recording = self._open_recording()
        recording.moment = self._clock.advance_to_event(event)
        recording.require_disk_space()
        text = replace_undrawable_chars(format_event_line(event)[:300])
        recording.log_row(Paths.LOG, rr.TextLog, text=[text], level=[event_log_level(event)])
        if isinstance(event, RunStarted | RunEnded | NodeStarted):
            self._machine.log_current_state(recording)
        self._log_document(recording, event)
        match event:
            case NodeEnded():
                recording.log_row(f"{Paths.METRICS}/seconds/{event.node}", rr.Scalars, scalars=[event.seconds])
            case Prompt():
                picture = event.images[0] if event.images else self._picture
                if picture and picture != self._picture:
                    if self._picture is None:
                        clear_placeholder(recording, Paths.IMAGE)
                    log_picture(recording, Paths.IMAGE, resolve_member_file(self._folder, picture))
                    self._picture = picture
            case Reply():
                recording.log_row(f"{Paths.METRICS}/tokens", rr.Scalars, scalars=[self._tokens])
            case ProgramVersion():
                log_program_version(recording, self._folder, event)
            case TestsRun():
                cases = event_markdown.get_test_cases(event)
                passed = sum(case.get("outcome") == "passed" for case in cases)
                for outcome, count in (("passed", passed), ("failed", len(cases) - passed)):
                    recording.log_row(f"{Paths.METRICS}/tests/{outcome}", rr.Scalars, scalars=[count])
            case SceneStage():
                self._scene.show_scene_stage(recording, event)
            case Rollout():
                self._clock.advance_by_seconds(self._rollouts.show_rollout(recording, event))
                seconds = np.array([rollout_duration(self._folder, event)])
                recording.log_columns(f"{Paths.METRICS}/reward", seconds, rr.Scalars.columns(scalars=[event.reward]))
            case _:
                pass

    def close(self) -> None:
        """Close the file."""
        if self._recording and self._recording is not self._to:
            self._recording.close()

    def _open_recording(self) -> RerunRecording:
        if self._recording is not None:
            return self._recording
        if isinstance(self._to, RerunRecording):
            recording = self._to
        else:
            recording = RerunRecording(self._to, self._run_id, build_run_blueprint(self._machine.nodes), self._live)
        self._recording = recording  # before any row, so that it is closed even if logging fails
        for outcome, color in (("passed", (46, 204, 113)), ("failed", (231, 76, 60))):
            lines = rr.SeriesLines(names=outcome, colors=[color], interpolation_mode=_STEPS)
            recording.log(f"{Paths.METRICS}/tests/{outcome}", lines, static=True)
        points = rr.SeriesPoints(names="reward of a rollout", colors=[(241, 196, 15)], marker_sizes=[5])
        recording.log(f"{Paths.METRICS}/reward", points, static=True)
        tokens = rr.SeriesLines(names="tokens so far", interpolation_mode=_STEPS)
        recording.log(f"{Paths.METRICS}/tokens", tokens, static=True)
        self._machine.log_static_graph(recording)
        if self._clock.now == recording.moment:  # the run begins
            for path in (*_DOCUMENTS, Paths.PROMPT, Paths.REPLY):
                recording.log_markdown(path, NOT_YET)
            log_placeholders(recording)
            for name in ("tests/passed", "tests/failed", "tokens"):
                recording.log_row(f"{Paths.METRICS}/{name}", rr.Scalars, scalars=[0])
            self._machine.log_current_state(recording)
        return recording

    def _remember_event_context(self, event: Event) -> None:
        """Update the state that later events are shown with."""
        if isinstance(event, RunStarted):
            self._run_id = event.run_id
        elif isinstance(event, Reply):
            self._tokens += event.input_tokens + event.output_tokens
        elif isinstance(event, Finding):
            self._findings.append(event)
        elif isinstance(event, NodeStarted) and event.node == "audit":
            self._findings.clear()
        self._machine.track_event(event)

    def _log_document(self, recording: RerunRecording, event: Event) -> None:
        match event:
            case RunStarted():
                path, markdown = Paths.DECISION, event_markdown.format_run_start(event)
            case RunEnded():
                path, markdown = Paths.DECISION, event_markdown.format_run_end(event)
            case Decision():
                path, markdown = Paths.DECISION, event_markdown.format_decision(event)
            case Prompt():
                path, markdown = Paths.PROMPT, event_markdown.format_prompt(event)
            case Reply():
                path, markdown = Paths.REPLY, event_markdown.format_reply(event)
            case ToolCall():
                path, markdown = Paths.REPLY, event_markdown.format_tool_call(event)
            case TestsRun():
                path, markdown = Paths.REPORT, event_markdown.format_test_report(event)
            case TaskDefined():
                path, markdown = Paths.TASK, event_markdown.format_task(event)
            case Finding():
                path, markdown = Paths.AUDIT, event_markdown.format_audit(self._findings)
            case _:
                return
        recording.log_markdown(path, markdown)


class RerunView:
    """Logs every event in rerun; rows reach the file within seconds, so a killed run leaves its recording.

    A resumed run continues in ``trace.1.rrd`` and so on with the same recording id, so that all parts open as a
    single recording; :meth:`finish` leaves a single ``trace.rrd``.
    """

    def __init__(self, run_folder: Path, library: Library, live: str | None = None) -> None:
        self._folder, self._library = run_folder, library
        log = run_folder / "events.jsonl"
        earlier = read_events(log) if log.exists() else []
        file = run_folder / TRACE
        self._resumed = bool(earlier) and file.exists()
        self._live = live is not None
        if self._resumed:
            names = (run_folder / f"trace.{number}.rrd" for number in count(1))
            file = next(name for name in names if not name.exists())
        self._view = EventView(run_folder, library, file, live)
        show = self._view.track_event_without_logging if self._resumed else self._view.write_event
        with ExitStack() as opened:
            opened.callback(self._view.close)
            for event in earlier:
                show(event)
            opened.pop_all()

    def __call__(self, event: Event) -> None:
        """Log an event."""
        self._view.write_event(event)

    def finish(self) -> None:
        """Close the file. After a resumption or with a live viewer, ``trace.rrd`` is rebuilt from the events of all
        parts: a viewer that is closed early breaks the file."""
        self._view.close()
        if self._resumed or self._live:
            rebuild_rrd_file(self._folder, self._library)


def record_comparison(runs: Sequence[tuple[Path, Library]], path: Path) -> Path:
    """Record runs side by side, below ``/run_1``, ``/run_2``, ..., on common timelines."""
    logs = [read_events(folder / "events.jsonl") for folder, _ in runs]
    names = [folder.resolve().name for folder, _ in runs]
    if len(set(names)) < len(names):
        names = [f"{number} {name}" for number, name in enumerate(names, start=1)]
    columns: list[tuple[str, str, tuple[str, ...]]] = []
    for number, (name, events) in enumerate(zip(names, logs, strict=True), start=1):
        machine = MachineView()
        for event in events:
            machine.track_event(event)
        columns.append((name, f"/run_{number}", machine.nodes))
    recording = RerunRecording(path, " and ".join(names), build_comparison_blueprint(columns))
    with closing(recording):
        for (folder, library), (_, prefix, _), events in zip(runs, columns, logs, strict=True):
            view = EventView(folder, library, recording.with_path_prefix(prefix))
            for event in events:
                view.write_event(event)
    return path


def record_run(run_folder: Path, library: Library, path: Path) -> bool:
    """Record a run, as far as it has come, into the file ``path``. Returns: False if it has no event yet."""
    events = read_events(run_folder / "events.jsonl")
    with closing(EventView(run_folder, library, path)) as view:
        for event in events:
            view.write_event(event)
    return bool(events)


def rebuild_rrd_file(run_folder: Path, library: Library) -> Path:
    """Rebuild ``trace.rrd`` from ``events.jsonl`` and its files; delete the parts of resumed runs."""
    temporary = run_folder / f".{TRACE}"
    if record_run(run_folder, library, temporary):
        temporary.replace(run_folder / TRACE)
        for part in run_folder.glob("trace.[0-9]*.rrd"):
            part.unlink()
    return run_folder / TRACE
