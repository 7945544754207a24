"""``grs run`` and ``grs scene``."""

import sys
from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path

from rich.console import Console

from grs_agents.config import Config
from grs_agents.library import Library
from grs_agents.run import Order, execute
from grs_agents.trace import EventLog


def run_graph(command: str, scene: Path, config: Config, out: Path | None, resume: bool, as_json: bool) -> int:
    """Run the configured graph with its recording and live progress, and print the end.

    Returns:
        The exit status.
    """
    from grs_agents.views import summary_table

    folder, record, problem = execute(Order(command, scene, config, out, resume), follow)
    if as_json:
        print(record.model_dump_json(indent=2))
    else:
        console = Console()
        console.print(summary_table(record.model_dump(mode="json")))
        console.print(f"[bold]grs replay {folder}[/bold]   opens the trace", highlight=False)
    if problem is not None:
        print(f"grs: {problem}", file=sys.stderr)
    return record.exit_status or 0


@contextmanager
def follow(folder: Path, log: EventLog) -> Generator[None]:
    """Let the terminal's progress and the rerun recording follow the log; both are closed whatever happens."""
    from grs_agents.views import Progress
    from grs_agents.views.rerun_view import RerunView

    view = RerunView(folder, Library())
    with Progress() as progress:
        log.subscribe(progress)
        log.subscribe(view)
        try:
            yield
        finally:
            view.finish()
