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
from grs_agents.cli.run_outputs import write_report
from grs_agents.perception.edits import read_edits
from grs_agents.perception.reading.scene_source import resolve_scene_path
from grs_agents.runs.execution import execute_run
from grs_agents.runs.run_opening import RunOrder
from grs_agents.runs.scene_editor import SceneEditor, open_scene_editor
from grs_agents.views.common.event_steps import format_event_line
from grs_agents.views.edit_page.guard import GuardedServer
from grs_agents.views.edit_page.page import EditPage, EndedRun
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
        with open_scene_editor(resolve_scene_path(scene), out, perception, attach_live_views) as editor:
            for edit in given:
                editor.apply(edit)
            page = EditPage(editor, server, partial(_go_on, editor, config))
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


def _go_on(editor: SceneEditor, config: EffectiveConfig, show: Callable[[str], None]) -> EndedRun:
    """Run the graph from the saved scene."""

    @contextmanager
    def views(folder: Path, log: EventLog) -> Generator[None]:
        def show_step(event: Event) -> None:
            if isinstance(event, NodeEnded):
                show(format_event_line(event))

        log.subscribe(show_step)
        with attach_live_views(folder, log, progress=False):
            yield

    ended = execute_run(RunOrder("run", editor.folder, config), views)
    if ended.problem is not None:
        raise ended.problem
    report = write_report(ended.folder, None, lambda _: None)
    return EndedRun(ended.folder, ended.record.status, ended.record.reason, report.read_bytes())
