"""``grs check``."""

import tempfile
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

from rich.table import Table
from rich.text import Text

from grs_agents import terminal
from grs_agents.audit import AuditReport
from grs_agents.config import Config, Effective, validate_config
from grs_agents.errors import InputError
from grs_agents.foreign import check_run_folder
from grs_agents.perception import read_scene_description, resolve_scene_path
from grs_agents.run import CheckOrder, Order, check_user_program, execute_run, read_record
from grs_agents.sandbox import TestReport
from grs_agents.sim.arms import find_arm_file
from grs_agents.terminal import print_json
from grs_agents.views import attach_live_views, show_activity_status

_SCENE_FILE = "scene.json"


def check_program(
    program: Path, tests: Path | None, task: Path | None, scene: Path | None, chosen: Effective, as_json: bool
) -> int:
    """Check a program and print what was found; 0 if its tests pass and the audit accepts it, 1 if not.

    ``program`` is its file, or the folder of a run that ended with it; then tests, task and scene are the run's where
    none are named.
    """
    if program.is_dir():
        run, program = program, program / "simulation.py"
        tests = tests or _file_if_any(run / "test_simulation.py")
        task, scene = task or _file_if_any(run / "task.json"), scene or run
    with tempfile.TemporaryDirectory(prefix="grs-check-") as folder:
        order = CheckOrder(program, tests, chosen.config, Path(folder) / "check", task, name=program.stem)
        if scene is not None:
            seen = _find_or_comprehend_scene(scene, chosen, Path(folder) / "scene")
            around = {"scene": _file_if_any(seen), "assets": seen.parent.resolve() / "assets"}
            order = replace(order, config=_config_matching_run(seen.parent, chosen), **around)
        with show_activity_status("checking the program"):
            report, audit = check_user_program(order)
    accepted = audit.accepted and (report is None or report.all_passed)
    if as_json:
        value = {
            "status": "accepted" if accepted else "rejected",
            "tests": report and report.model_dump(mode="json"),
            "audit": audit.model_dump(mode="json"),
        }
        print_json(value)
    else:
        _print_check_result(report, audit, accepted)
    return 0 if accepted else 1


def _file_if_any(file: Path) -> Path | None:
    return file if file.is_file() else None


def _find_or_comprehend_scene(scene: Path, chosen: Effective, out: Path) -> Path:
    """The file of a scene, beside which its assets lie: a run's, the one named, or that of a photo comprehended now."""
    if scene.suffix == ".json":
        read_scene_description(scene)
        if (scene.parent / "assets").is_dir():
            check_run_folder(scene.parent / "assets")
        return scene
    if (scene / "run.json").exists():
        read_record(scene)
        return scene / _SCENE_FILE
    config = validate_config({**chosen.config.model_dump(), "graph": "scene", "record": None, "cassette": None})
    ended = execute_run(Order("scene", resolve_scene_path(scene), config, out), attach_live_views)
    if ended.problem is not None:
        raise ended.problem
    if ended.record.status != "accepted":
        raise InputError(f"{scene} was not comprehended: {ended.record.reason}", "name another scene with --scene")
    return out / _SCENE_FILE


def _config_matching_run(folder: Path, chosen: Effective) -> Config:
    """The configuration with the robot and the seed of the run in ``folder``, where the user names none."""
    recorded = read_record(folder).config if (folder / "run.json").is_file() else {}
    same = {key: recorded[key] for key in ("robot", "seed") if key in recorded and chosen.sources[key] == "default"}
    if "robot" in same:
        same["robot"] = find_arm_file(folder, str(same["robot"]))
    return validate_config({**chosen.config.model_dump(), **same})


def _print_check_result(report: TestReport | None, audit: AuditReport, accepted: bool) -> None:
    console = terminal.make_console()
    table = Table(box=None, pad_edge=False, header_style="bold", title="accepted" if accepted else "rejected")
    for column in ("check", "result", "measured", "asked"):
        table.add_column(column, overflow="fold", no_wrap=column in ("check", "result"))
    for row in (*_test_table_rows(report), *_audit_table_rows(audit)):
        table.add_row(*map(Text, row))
    console.print(table)
    console.print(Text(audit.about))


def _test_table_rows(report: TestReport | None) -> Iterator[tuple[str, ...]]:
    if report is None:
        return
    if not report.cases:
        yield "tests", report.outcome, report.message
    for case in report.cases:  # their class is the same for all, and long
        yield case.id.rpartition(".")[2], case.outcome, case.message


def _audit_table_rows(audit: AuditReport) -> Iterator[tuple[str, ...]]:
    for finding in audit.findings:
        yield finding.check, "passed" if finding.passed else "failed", finding.measured, finding.bound
    for rollout in audit.rollouts:
        episode = rollout.episode
        yield f"seed {rollout.seed}", episode.outcome, f"reward {episode.reward:.2f}: {episode.detail}"
    for warning in dict.fromkeys(warning for rollout in audit.rollouts for warning in rollout.warnings):
        yield "warning", "", warning
