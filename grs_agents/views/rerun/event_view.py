"""Events into a rerun recording, one after the other; of programs the code and what changed line by line."""

from pathlib import Path

import numpy as np
import rerun as rr

from grs_agents import trace
from grs_agents.foreign import member, read_bytes
from grs_agents.library import Library
from grs_agents.views.common import drawable, event_documents, level, line
from grs_agents.views.rerun.recording import Clock, Paths, Recording
from grs_agents.views.rerun.rollout_view import RolloutView, duration
from grs_agents.views.rerun.scene_view import SceneView, log_picture
from grs_agents.views.rerun.state_machine import MachineView
from grs_agents.views.rerun.viewer_layout import blueprint

_COLORS = {"+": (90, 220, 110), "-": (255, 105, 105), "@": (110, 170, 255)}
_GREY = (165, 165, 170)
_LONGEST = 400


def log_program(recording: Recording, folder: Path, event: trace.ProgramVersion) -> None:
    """Show one version: its file as a document, its diff as coloured lines."""
    path = Paths.SIMULATION if event.program == "simulation" else Paths.TESTS
    source = read_bytes(member(folder, event.path)).decode("utf-8", "replace")
    recording.text(path, event_documents.program(event, source))
    head = f"{event.program} version {event.number}" + (f" by {event.author_role}" if event.author_role else "")
    lines = [head, *_changed(event, source)]
    columns = rr.TextLog.columns(
        text=[drawable(line) for line in lines],
        level=["INFO"] * len(lines),
        color=[(255, 255, 255), *(_COLORS.get(line[:1], _GREY) for line in lines[1:])],
    )
    recording.columns(Paths.DIFF, np.zeros(len(lines)), columns)


def _changed(event: trace.ProgramVersion, source: str) -> list[str]:
    """The lines of the diff without its file names; of a first version only how long it is."""
    if event.parent is None or not event.diff:
        return [f"  {len(source.splitlines())} lines, new"]
    lines = [line for line in event.diff.splitlines() if not line.startswith(("---", "+++"))]
    more = [f"  ... {len(lines) - _LONGEST} more lines"] if len(lines) > _LONGEST else []
    return [*lines[:_LONGEST], *more]


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
        self._findings: list[trace.Finding] = []
        self._recording: Recording | None = None

    def skip(self, event: trace.Event) -> None:
        """Take in an event that an earlier part of the recording shows."""
        self._follow(event)
        self._clock.tick(event)
        if isinstance(event, trace.Rollout):
            self._clock.play(duration(self._folder, event))

    def write(self, event: trace.Event) -> None:
        """Show ``event``; it is in the file a moment later."""
        self._follow(event)
        recording = self._open()
        recording.moment = self._clock.tick(event)
        recording.require_space()
        recording.row(Paths.LOG, rr.TextLog, text=[drawable(line(event)[:300])], level=[level(event)])
        self._show(recording, event)

    def close(self) -> None:
        """Finish the file."""
        if self._recording and self._recording is not self._to:
            self._recording.close()

    def _open(self) -> Recording:
        if self._recording is None:
            if isinstance(self._to, Recording):
                recording = self._to
            else:
                recording = Recording(self._to, self._run_id, blueprint(self._machine.nodes), self._live)
            for outcome, color in (("passed", (46, 204, 113)), ("failed", (231, 76, 60))):
                lines = rr.SeriesLines(names=outcome, colors=[color])
                recording.log(f"{Paths.METRICS}/tests/{outcome}", lines, static=True)
            points = rr.SeriesPoints(names="reward of a rollout", colors=[(241, 196, 15)], marker_sizes=[5])
            recording.log(f"{Paths.METRICS}/reward", points, static=True)
            recording.log(f"{Paths.METRICS}/tokens", rr.SeriesLines(names="tokens so far"), static=True)
            self._machine.prepare(recording)
            self._recording = recording
        return self._recording

    def _follow(self, event: trace.Event) -> None:
        """Keep what later events are shown with."""
        if isinstance(event, trace.RunStarted):
            self._run_id = event.run_id
        elif isinstance(event, trace.Reply):
            self._tokens += event.input_tokens + event.output_tokens
        elif isinstance(event, trace.Finding):
            self._findings.append(event)
        elif isinstance(event, trace.NodeStarted) and event.node == "audit":
            self._findings.clear()
        self._machine.follow(event)

    def _show(self, recording: Recording, event: trace.Event) -> None:
        if isinstance(event, trace.RunStarted | trace.RunEnded | trace.NodeStarted):
            self._machine.show(recording)
        for path, markdown in self._texts(event):
            recording.text(path, markdown)
        match event:
            case trace.NodeEnded():
                recording.row(f"{Paths.METRICS}/seconds/{event.node}", rr.Scalars, scalars=[event.seconds])
            case trace.Prompt():
                self._pictures(recording, event)
            case trace.Reply():
                recording.row(f"{Paths.METRICS}/tokens", rr.Scalars, scalars=[self._tokens])
            case trace.ProgramVersion():
                log_program(recording, self._folder, event)
            case trace.TestsRun():
                _log_tests(recording, event)
            case trace.SceneStage():
                self._scene.show(recording, event)
            case trace.Rollout():
                self._rollout(recording, event)
            case _:
                pass

    def _texts(self, event: trace.Event) -> list[tuple[str, str]]:
        """The documents that ``event`` changes: where and what."""
        match event:
            case trace.RunStarted():
                shown = (Paths.DECISION, event_documents.started(event))
            case trace.RunEnded():
                shown = (Paths.DECISION, event_documents.ended(event))
            case trace.Decision():
                shown = (Paths.DECISION, event_documents.decision(event))
            case trace.Prompt():
                shown = (Paths.PROMPT, event_documents.prompt(event))
            case trace.Reply():
                shown = (Paths.REPLY, event_documents.reply(event))
            case trace.TestsRun():
                shown = (Paths.REPORT, event_documents.tests(event))
            case trace.TaskDefined():
                shown = (Paths.TASK, event_documents.task(event))
            case trace.Finding():
                shown = (Paths.AUDIT, event_documents.audit(self._findings))
            case _:
                return []
        return [shown]

    def _pictures(self, recording: Recording, event: trace.Prompt) -> None:
        """The first picture of the prompt, if it is another than the last prompt's."""
        picture = event.images[0] if event.images else None
        if picture and picture != self._picture:
            log_picture(recording, Paths.IMAGE, member(self._folder, picture))
        elif self._picture and not picture:
            recording.log(Paths.IMAGE, rr.EncodedImage.cleared())  # the viewer goes on to show an image after Clear
        self._picture = picture

    def _rollout(self, recording: Recording, event: trace.Rollout) -> None:
        self._clock.play(self._rollouts.show(recording, event))
        reward = rr.Scalars.columns(scalars=[event.reward])
        recording.columns(f"{Paths.METRICS}/reward", np.array([duration(self._folder, event)]), reward)


def _log_tests(recording: Recording, event: trace.TestsRun) -> None:
    cases = event_documents.cases_of(event)
    passed = sum(case.get("outcome") == "passed" for case in cases)
    for outcome, count in (("passed", passed), ("failed", len(cases) - passed)):
        recording.row(f"{Paths.METRICS}/tests/{outcome}", rr.Scalars, scalars=[count])
