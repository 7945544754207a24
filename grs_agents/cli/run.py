"""``grs run``, ``grs scene`` and ``grs approve``."""

import shlex
import sys
import traceback
from contextlib import nullcontext
from dataclasses import replace
from functools import partial
from pathlib import Path

import typer
from rich.table import Table
from rich.text import Text

from grs_agents.base import terminal
from grs_agents.base.config.load import UNSAFE, EffectiveConfig
from grs_agents.base.config.recorded import list_local_settings
from grs_agents.base.content import list_content_options
from grs_agents.base.errors import GrsError, InputError
from grs_agents.base.foreign.files import read_json
from grs_agents.base.questions import Question, require_reply_is_a_choice
from grs_agents.base.terminal import print_escaped, print_json
from grs_agents.perception.coverage import describe_coverage
from grs_agents.perception.edits import read_edits
from grs_agents.perception.reading.scene_source import resolve_scene_path
from grs_agents.perception.types import SceneDescription, read_scene_description
from grs_agents.runs.execution import WAITING, Outcome, UnexpectedError, Views, execute_run
from grs_agents.runs.record import RunRecord, read_record
from grs_agents.runs.run_opening import RunOrder
from grs_agents.views.common.foreign_decoding import decode_in_worker
from grs_agents.views.live_views import attach_live_views
from grs_agents.views.terminal import summary_table


def run_graph(
    command: str,
    scene: Path,
    config: EffectiveConfig,
    out: Path | None,
    resume: bool,
    as_json: bool,
    view: bool = False,
    otel: bool = False,
    recorded_source: bool = False,
    edits: Path | None = None,
) -> int:
    """Run the configured graph with recording and live progress, and print the outcome."""
    given = {} if edits is None else {"edits": read_edits(edits)}
    source = resolve_scene_path(scene)
    order = RunOrder(command, source, config, out, resume, given, recorded_source=recorded_source)
    return run_until_ended_and_print(order, scene, as_json, partial(attach_live_views, view=view, otel=otel))


def execute_order(order: RunOrder, views: Views) -> Outcome:
    """Execute a run; what it finds in the folder that it resumes, which may be foreign, is decoded in a worker."""
    with decode_in_worker(order.out) if order.resume and order.out else nullcontext():
        return execute_run(order, views)


def run_until_ended_and_print(order: RunOrder, scene: Path, as_json: bool, views: Views = attach_live_views) -> int:
    """Run the order, ask its questions at the terminal, and print the outcome."""
    ended = execute_order(order, views)
    while ended.record.question is not None and sys.stdin.isatty() and not as_json:
        print_question(ended.record.question)
        reply = typer.prompt("reply")
        try:
            require_reply_is_a_choice(ended.record.question, reply)
        except InputError as error:
            print_escaped(f"grs: {error}", error=True)
            continue
        ended = execute_run(replace(order, out=ended.folder, resume=True, reply=reply), views)
    command = order.command
    # the settings that a run folder cannot choose are repeated on the command line of a resumption
    local = [UNSAFE] if order.config.config.sandbox == "none" else []
    local += [part for setting in list_local_settings(order.config) for part in ("--set", setting)]
    if as_json:
        print_json(ended.record.model_dump(mode="json"))
    elif ended.problem is None and terminal.VERBOSITY.get() == "quiet":
        print_escaped(ended.folder)
    elif ended.problem is None:
        _print_run_summary(command, ended.folder, ended.record)
    if ended.problem is not None:
        _print_run_error(ended.problem, ended.folder)
    if ended.record.status == "interrupted" and command == "run":
        again = shlex.join(
            ["grs", *list_content_options(), "run", str(scene), "--out", str(ended.folder), "--resume", *local]
        )
        print_escaped(f"interrupted; to go on: {again}", error=True)
    if ended.record.status == "waiting":
        again = shlex.join(["grs", *list_content_options(), "approve", str(ended.folder), "--reply", "...", *local])
        print_escaped(f"waiting for a reply; to go on: {again}", error=True)
    return ended.record.exit_status or 0


def approve_run(folder: Path, reply: str | None, config: EffectiveConfig, as_json: bool) -> int:
    """Resume a waiting run with a reply; without a reply print its question, and ask it on a terminal."""
    record = read_record(folder)
    if record.question is None:
        remedy = shlex.join(["grs", "show", str(folder)])
        raise InputError(f"the run {folder} is {record.status} and waits for no reply", remedy)
    if reply is None and not sys.stdin.isatty():
        print_json(record.question.model_dump(mode="json")) if as_json else print_question(record.question)
        return WAITING
    source = Path(record.source)
    order = RunOrder(record.command, source, config, folder, True, reply=reply, recorded_source=True)
    return run_until_ended_and_print(order, source, as_json)


def print_question(question: Question) -> None:
    """Print the details, the question and the choices."""
    print_escaped("\n".join(filter(None, (question.details, question.text))))
    if question.choices:
        print_escaped(f"choices: {', '.join(question.choices)}")


def _print_run_summary(command: str, folder: Path, record: RunRecord) -> None:
    console = terminal.make_console()
    scene = read_scene_description(folder / "scene.json") if (folder / "scene.json").is_file() else None
    coverage = None if scene is None or scene.coverage is None else scene.coverage
    if scene is not None and coverage is not None and describe_coverage(coverage) in scene.warnings:
        console.print(Text(describe_coverage(coverage), style="bold yellow"))
    if scene is not None and command == "scene" and record.exit_status == 0:
        console.print(build_objects_table(scene))
        if coverage is not None:
            console.print(Text(f"{describe_coverage(coverage)} ({folder / coverage.picture})"))
    else:
        if (folder / "task.json").is_file():
            words = read_json(folder / "task.json", "run again").get("task-description")
            console.print(Text(f"task     {words}", style="bold"))
        console.print(summary_table(record.model_dump(mode="json")))
    replay = shlex.join(["grs", "replay", str(folder)])
    console.print(Text.assemble((replay, "bold"), "   opens the trace"), soft_wrap=True)
    if record.sentence:
        console.print(Text(f"sentence {record.sentence}", style="bold"), soft_wrap=True)


def _print_run_error(problem: GrsError, folder: Path) -> None:
    """A line for the error, a traceback for an unexpected error, and the folder to resume."""
    print_escaped(f"grs: {problem}", error=True)
    if isinstance(problem, InputError):
        if terminal.VERBOSITY.get() == "verbose":
            print_escaped("".join(traceback.format_exception(problem)), error=True, end="")
        return
    if isinstance(problem, UnexpectedError):
        print_escaped("".join(traceback.format_exception(problem.__cause__)), error=True)
    print_escaped(f"what was reached is in {folder}; --resume goes on there", error=True)


def build_objects_table(scene: SceneDescription) -> Table:
    """The objects of a scene for a terminal: sizes in centimetres, positions in metres in the robot frame."""
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
