"""``grs run`` and ``grs scene``."""

import shlex
import traceback
from functools import partial
from pathlib import Path

from rich.table import Table
from rich.text import Text

from grs_agents import terminal
from grs_agents.config import Config
from grs_agents.errors import GrsError, InputError
from grs_agents.perception import SceneDescription, read_scene_description, resolve_scene_path
from grs_agents.run import Order, RunRecord, UnexpectedError, execute_run
from grs_agents.terminal import print_escaped, print_json
from grs_agents.views import attach_live_views, summary_table


def run_graph(
    command: str,
    scene: Path,
    config: Config,
    out: Path | None,
    resume: bool,
    as_json: bool,
    view: bool = False,
    otel: bool = False,
) -> int:
    """Run the configured graph with its recording and live progress, and print the end."""
    order = Order(command, resolve_scene_path(scene), config, out, resume)
    ended = execute_run(order, partial(attach_live_views, view=view, otel=otel))
    if as_json:
        print_json(ended.record.model_dump(mode="json"))
    elif ended.problem is None:
        _print_run_summary(command, ended.folder, ended.record)
    if ended.problem is not None:
        _print_run_error(ended.problem, ended.folder)
    if ended.record.status == "interrupted" and command == "run":
        again = shlex.join(["grs", "run", str(scene), "--out", str(ended.folder), "--resume"])
        print_escaped(f"interrupted; to go on: {again}", error=True)
    return ended.record.exit_status or 0


def _print_run_summary(command: str, folder: Path, record: RunRecord) -> None:
    console = terminal.make_console()
    if command == "scene" and record.exit_status == 0:
        console.print(build_objects_table(read_scene_description(folder / "scene.json")))
    else:
        console.print(summary_table(record.model_dump(mode="json")))
    console.print(Text.assemble((f"grs replay {folder}", "bold"), "   opens the trace"))


def _print_run_error(problem: GrsError, folder: Path) -> None:
    """One line; what nobody foresaw has its traceback too, and what was reached can be gone on with."""
    print_escaped(f"grs: {problem}", error=True)
    if isinstance(problem, InputError):
        return
    if isinstance(problem, UnexpectedError):
        print_escaped("".join(traceback.format_exception(problem.__cause__)), error=True)
    print_escaped(f"what was reached is in {folder}; --resume goes on there", error=True)


def build_objects_table(scene: SceneDescription) -> Table:
    """The objects of a scene for a terminal: sizes in centimetres, positions in metres in the robot's frame."""
    table = Table(box=None, pad_edge=False, padding=(0, 1, 0, 0), header_style="bold")
    table.add_column("name", overflow="fold")
    table.add_column("asset", overflow="fold")
    for column in ("size (cm)", "position (m)", "reach"):
        table.add_column(column, no_wrap=True)
    for item in scene.objects:
        size = "x".join(f"{100 * extent:.1f}" for extent in item.size)
        position = ", ".join(f"{value:.2f}" for value in item.position)
        table.add_row(*map(Text, (item.name, item.asset, size, position, "yes" if item.reachable else "no")))
    return table
