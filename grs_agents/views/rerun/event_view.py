"""Events into a rerun recording, one after the other; of programs the code and what changed line by line."""

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
from grs_agents.library.library import Library
from grs_agents.views.common import event_markdown
from grs_agents.views.common.event_steps import event_log_level, format_event_line
from grs_agents.views.common.safe_text import replace_undrawable_chars
from grs_agents.views.rerun.recording import Clock, Paths, Recording
from grs_agents.views.rerun.rollout_view import RolloutView, rollout_duration
from grs_agents.views.rerun.scene_view import SceneView, log_picture
from grs_agents.views.rerun.state_machine_view import MachineView
from grs_agents.views.rerun.viewer_layout import build_run_blueprint
from grs_agents.views.rerun.waiting import NOT_YET, clear_placeholder, log_placeholders

_COLORS = {"+": (30, 150, 70), "-": (215, 70, 70), "@": (60, 130, 230)}
_GREY, _VIOLET = (125, 125, 132), (150, 100, 215)
"""Colours that are read on a light ground and on a dark one."""
_DOCUMENTS = (Paths.DECISION, Paths.TASK, Paths.OBJECTS, Paths.AUDIT, Paths.SIMULATION, Paths.TESTS, Paths.REPORT)
_LONGEST = 400
_STEPS = rr.components.InterpolationMode.StepAfter


def log_program_version(recording: Recording, folder: Path, event: ProgramVersion) -> None:
    """Show one version: its file as a document, its diff as coloured lines."""
    path = Paths.SIMULATION if event.program == "simulation" else Paths.TESTS
    source = read_bytes(resolve_member_file(folder, event.path)).decode("utf-8", "replace")
    recording.log_markdown(path, event_markdown.format_program(event, source))
    head = f"{event.program} version {event.number}" + (f" by {event.author_role}" if event.author_role else "")
    lines = [head, *_list_diff_lines(event, source)]
    text = [replace_undrawable_chars(line) for line in lines]
    color = [_VIOLET, *(_COLORS.get(line[:1], _GREY) for line in lines[1:])]
    columns = rr.TextLog.columns(text=text, level=["INFO"] * len(lines), color=color)
    recording.log_columns(Paths.DIFF, np.zeros(len(lines)), columns)


def _list_diff_lines(event: ProgramVersion, source: str) -> list[str]:
    """The lines of the diff without its file names; of a first version only how long it is."""
    if event.parent is None or not event.diff:
        return [f"  {len(source.splitlines())} lines, new"]
    lines = [line for line in event.diff.splitlines() if not line.startswith(("---", "+++"))]
    return [*lines[:_LONGEST], *([f"  ... {len(lines) - _LONGEST} more lines"] if len(lines) > _LONGEST else [])]


class EventView:
    """Writes events to the file ``to``, made with the first one, or into a recording, which is not closed here."""

    def __init__(self, folder: Path, library: Library, to: Path | Recording, live: str | None = None) -> None:
        self._folder, self._to, self._live = folder, to, live
        self._run_id = folder.name
        self._clock = Clock()
        self._machine = MachineView()
        self._scene = SceneView(folder, library)
        self._rollouts = RolloutView(folder, library)
        self._tokens = 0
        self._picture: str | None = None
        self._findings: list[Finding] = []
        self._recording: Recording | None = None

    def track_event_without_logging(self, event: Event) -> None:
        """Take in an event that an earlier part of the recording shows."""
        self._remember_event_context(event)
        self._clock.advance_to_event(event)
        if isinstance(event, Rollout):
            self._clock.advance_by_seconds(rollout_duration(self._folder, event))

    def write_event(self, event: Event) -> None:
        """Show ``event``; it is in the file a moment later."""
        self._remember_event_context(event)
        recording = self._open_recording()
        recording.moment = self._clock.advance_to_event(event)
        recording.require_disk_space()
        text = replace_undrawable_chars(format_event_line(event)[:300])
        recording.log_row(Paths.LOG, rr.TextLog, text=[text], level=[event_log_level(event)])
        self._log_event(recording, event)

    def close(self) -> None:
        """Finish the file."""
        if self._recording and self._recording is not self._to:
            self._recording.close()

    def _open_recording(self) -> Recording:
        if self._recording is None:
            if isinstance(self._to, Recording):
                recording = self._to
            else:
                recording = Recording(self._to, self._run_id, build_run_blueprint(self._machine.nodes), self._live)
            self._recording = recording  # before anything is shown, so that it is closed whatever comes
            for outcome, color in (("passed", (46, 204, 113)), ("failed", (231, 76, 60))):
                lines = rr.SeriesLines(names=outcome, colors=[color], interpolation_mode=_STEPS)
                recording.log(f"{Paths.METRICS}/tests/{outcome}", lines, static=True)
            points = rr.SeriesPoints(names="reward of a rollout", colors=[(241, 196, 15)], marker_sizes=[5])
            recording.log(f"{Paths.METRICS}/reward", points, static=True)
            recording.log(
                f"{Paths.METRICS}/tokens", rr.SeriesLines(names="tokens so far", interpolation_mode=_STEPS), static=True
            )
            self._machine.log_static_graph(recording)
            if self._clock.now == recording.moment:  # the run begins
                for path in (*_DOCUMENTS, Paths.PROMPT, Paths.REPLY):
                    recording.log_markdown(path, NOT_YET)
                log_placeholders(recording)
                for name in ("tests/passed", "tests/failed", "tokens"):
                    recording.log_row(f"{Paths.METRICS}/{name}", rr.Scalars, scalars=[0])
                self._machine.log_current_state(recording)
        return self._recording

    def _remember_event_context(self, event: Event) -> None:
        """Keep what later events are shown with."""
        if isinstance(event, RunStarted):
            self._run_id = event.run_id
        elif isinstance(event, Reply):
            self._tokens += event.input_tokens + event.output_tokens
        elif isinstance(event, Finding):
            self._findings.append(event)
        elif isinstance(event, NodeStarted) and event.node == "audit":
            self._findings.clear()
        self._machine.track_event(event)

    def _log_event(self, recording: Recording, event: Event) -> None:
        if isinstance(event, RunStarted | RunEnded | NodeStarted):
            self._machine.log_current_state(recording)
        for path, markdown in self._documents_for_event(event):
            recording.log_markdown(path, markdown)
        match event:
            case NodeEnded():
                recording.log_row(f"{Paths.METRICS}/seconds/{event.node}", rr.Scalars, scalars=[event.seconds])
            case Prompt():
                self._log_prompt_picture(recording, event)
            case Reply():
                recording.log_row(f"{Paths.METRICS}/tokens", rr.Scalars, scalars=[self._tokens])
            case ProgramVersion():
                log_program_version(recording, self._folder, event)
            case TestsRun():
                _log_test_counts(recording, event)
            case SceneStage():
                self._scene.show_scene_stage(recording, event)
            case Rollout():
                self._log_rollout(recording, event)
            case _:
                pass

    def _documents_for_event(self, event: Event) -> list[tuple[str, str]]:
        """The documents that ``event`` changes: where and what."""
        match event:
            case RunStarted():
                shown = (Paths.DECISION, event_markdown.format_run_start(event))
            case RunEnded():
                shown = (Paths.DECISION, event_markdown.format_run_end(event))
            case Decision():
                shown = (Paths.DECISION, event_markdown.format_decision(event))
            case Prompt():
                shown = (Paths.PROMPT, event_markdown.format_prompt(event))
            case Reply():
                shown = (Paths.REPLY, event_markdown.format_reply(event))
            case ToolCall():
                shown = (Paths.REPLY, event_markdown.format_tool_call(event))
            case TestsRun():
                shown = (Paths.REPORT, event_markdown.format_test_report(event))
            case TaskDefined():
                shown = (Paths.TASK, event_markdown.format_task(event))
            case Finding():
                shown = (Paths.AUDIT, event_markdown.format_audit(self._findings))
            case _:
                return []
        return [shown]

    def _log_prompt_picture(self, recording: Recording, event: Prompt) -> None:
        """The first picture of the prompt, if it is another than the one shown."""
        picture = event.images[0] if event.images else None
        if picture and self._picture is None:
            clear_placeholder(recording, Paths.IMAGE)
        if picture and picture != self._picture:
            log_picture(recording, Paths.IMAGE, resolve_member_file(self._folder, picture))
            self._picture = picture

    def _log_rollout(self, recording: Recording, event: Rollout) -> None:
        self._clock.advance_by_seconds(self._rollouts.show_rollout(recording, event))
        reward = rr.Scalars.columns(scalars=[event.reward])
        recording.log_columns(f"{Paths.METRICS}/reward", np.array([rollout_duration(self._folder, event)]), reward)


def _log_test_counts(recording: Recording, event: TestsRun) -> None:
    cases = event_markdown.get_test_cases(event)
    passed = sum(case.get("outcome") == "passed" for case in cases)
    for outcome, count in (("passed", passed), ("failed", len(cases) - passed)):
        recording.log_row(f"{Paths.METRICS}/tests/{outcome}", rr.Scalars, scalars=[count])
