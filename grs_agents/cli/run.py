"""``grs run``, ``grs scene`` and ``grs check``."""

import shlex
import tempfile
import traceback
from collections.abc import Iterator
from functools import partial
from pathlib import Path

from rich.table import Table
from rich.text import Text

from grs_agents import terminal
from grs_agents.audit import AuditReport
from grs_agents.config import Config, Effective, validate_config
from grs_agents.errors import GrsError, InputError
from grs_agents.perception import SceneDescription, read_scene_description, resolve_scene_path
from grs_agents.run import CheckOrder, Order, RunRecord, UnexpectedError, check_user_program, execute_run, read_record
from grs_agents.sandbox import TestReport
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


def check_program(program: Path, tests: Path | None, run: Path | None, chosen: Effective, as_json: bool) -> int:
    """Check a program and print what was found; 0 if its tests pass and the audit accepts it, 1 if not.

    ``program`` is its file, or the folder of a run that ended with it; it may use the assets of ``run``.
    """
    if program.is_dir():
        own = program / "test_simulation.py"
        tests, run = tests or (own if own.is_file() else None), run or program
        program = program / "simulation.py"
    config = _config_matching_run(run, chosen) if run else chosen.config
    with tempfile.TemporaryDirectory(prefix="grs-check-") as folder:
        report, audit = check_user_program(CheckOrder(program, tests, config, Path(folder), run))
    accepted = audit.accepted and (report is None or report.all_passed)
    if as_json:
        value = {
            "status": "accepted" if accepted else "rejected",
            "tests": None if report is None else report.model_dump(mode="json"),
            "audit": audit.model_dump(mode="json"),
        }
        print_json(value)
    else:
        _print_check_result(report, audit, accepted)
    return 0 if accepted else 1


def _config_matching_run(run: Path, chosen: Effective) -> Config:
    """The configuration with the robot and the seed of a run, where the user names none."""
    recorded = read_record(run).config
    same = {key: recorded[key] for key in ("robot", "seed") if key in recorded and chosen.sources[key] == "default"}
    return validate_config({**chosen.config.model_dump(), **same})


def _print_check_result(report: TestReport | None, audit: AuditReport, accepted: bool) -> None:
    console = terminal.make_console()
    table = Table(box=None, pad_edge=False, header_style="bold", title="accepted" if accepted else "rejected")
    for column in ("check", "result", "detail"):
        table.add_column(column, overflow="fold", no_wrap=column != "detail")
    for row in (*_test_table_rows(report), *_audit_table_rows(audit)):
        table.add_row(*map(Text, row))
    console.print(table)
    console.print(Text(audit.about))


def _test_table_rows(report: TestReport | None) -> Iterator[tuple[str, str, str]]:
    if report is None:
        return
    if not report.cases:
        yield "tests", report.outcome, report.message
    for case in report.cases:  # their class is the same for all, and long
        yield case.id.rpartition(".")[2], case.outcome, case.message


def _audit_table_rows(audit: AuditReport) -> Iterator[tuple[str, str, str]]:
    for finding in audit.findings:
        yield finding.check, "passed" if finding.passed else "failed", finding.detail
    for rollout in audit.rollouts:
        episode = rollout.episode
        yield f"seed {rollout.seed}", episode.outcome, f"reward {episode.reward:.2f}: {episode.detail}"
    for warning in dict.fromkeys(warning for rollout in audit.rollouts for warning in rollout.warnings):
        yield "warning", "", warning
