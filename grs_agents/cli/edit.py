"""``grs edit``."""

import webbrowser
from collections.abc import Callable, Generator
from contextlib import contextmanager, suppress
from functools import partial
from pathlib import Path

from grs_agents.base.config.load import EffectiveConfig
from grs_agents.base.terminal import print_escaped
from grs_agents.base.trace.events import Event, NodeEnded
from grs_agents.base.trace.log import EventLog
from grs_agents.cli.run import execute_order
from grs_agents.cli.run_outputs import write_report
from grs_agents.graph.editing import REVIEW
from grs_agents.perception.edits import FILE, read_edits
from grs_agents.perception.reading.known_scene import is_known_scene
from grs_agents.perception.reading.scene_source import resolve_scene_path
from grs_agents.runs.record import read_record
from grs_agents.runs.run_opening import RunOrder
from grs_agents.runs.scene_editor import SceneEditor, open_scene_editor
from grs_agents.views.common.event_steps import format_event_line
from grs_agents.views.edit_page.editor import EndedRun
from grs_agents.views.edit_page.guard import GuardedServer
from grs_agents.views.edit_page.page import EditPage
from grs_agents.views.live_views import attach_live_views


def edit_scene(
    scene: Path,
    perception: EffectiveConfig,
    config: EffectiveConfig,
    out: Path | None,
    edits: Path | None,
    port: int,
    browser: bool,
) -> int:
    """Perceive a scene and serve the page on which a person corrects it. Returns: exit status."""
    given = () if edits is None else read_edits(edits).edits
    server = GuardedServer(port)  # a taken port is an error before perception
    try:
        source = resolve_scene_path(scene)
        with open_scene_editor(source, out, perception, attach_live_views) as editor:
            for edit in given:
                editor.apply(edit)
            page = EditPage(editor, server, partial(_go_on, source, editor, config))
            print_escaped(f"{editor.folder}: correct the scene at {server.address}")
            print_escaped("Ctrl-C saves and ends.")
            if browser:
                webbrowser.open(server.address)
            with suppress(KeyboardInterrupt):
                page.serve()
            print_escaped(f"{len(editor.edits)} edits; go on with grs run {editor.folder}")
    finally:
        server.stop()
    return 0


def order_run(source: Path, folder: Path, config: EffectiveConfig) -> RunOrder:
    """The run from a saved scene: that of ``source`` goes on if it waits for a review, else a new one begins."""
    record = read_record(source) if is_known_scene(source) else None
    if record is None or record.question is None or record.question.text != REVIEW:
        return RunOrder("run", folder, config)
    reply = str((folder / FILE).resolve())
    return RunOrder(record.command, Path(record.source), config, source, resume=True, reply=reply, recorded_source=True)


def _go_on(source: Path, editor: SceneEditor, config: EffectiveConfig, show: Callable[[str], None]) -> EndedRun:
    """Run the graph from the saved scene."""

    @contextmanager
    def views(folder: Path, log: EventLog) -> Generator[None]:
        def show_step(event: Event) -> None:
            if isinstance(event, NodeEnded):
                show(format_event_line(event))

        log.subscribe(show_step)
        with attach_live_views(folder, log, progress=False):
            yield

    ended = execute_order(order_run(source, editor.folder, config), views)
    if ended.problem is not None:
        raise ended.problem
    report = write_report(ended.folder, None, lambda _: None)
    return EndedRun(ended.folder, ended.record.status, ended.record.reason, report.read_bytes())
