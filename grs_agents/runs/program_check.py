"""Check of a simulation program outside a run, with the same sandbox, tests, instances, oracle and audit."""

import tempfile
from collections.abc import Callable, Generator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pydantic import ValidationError

from grs_agents.agents.agent import Agents
from grs_agents.agents.types import TaskDefinition
from grs_agents.audit.types import AuditReport
from grs_agents.base.config.load import EffectiveConfig, change_config
from grs_agents.base.config.recorded import RecordedConfig
from grs_agents.base.config.schema import Config
from grs_agents.base.errors import InputError
from grs_agents.base.files import copy_folder, write_json, write_text
from grs_agents.base.foreign.files import read_json, read_text
from grs_agents.base.foreign.run_folder import check_run_folder
from grs_agents.base.trace.log import EventLog
from grs_agents.graph.auditing import audit_programs
from grs_agents.graph.authoring import PROGRAM_FILES
from grs_agents.graph.bystanders import program_tool_settings
from grs_agents.graph.policies.policy_registry import load_policy
from grs_agents.graph.rejection import explain_rejection
from grs_agents.graph.services import Services
from grs_agents.graph.task_instances import AuditedPrograms
from grs_agents.perception.reading.scene_source import resolve_scene_path
from grs_agents.perception.types import read_scene_description
from grs_agents.runs.record import read_record
from grs_agents.runs.run_opening import RunOrder
from grs_agents.runs.sandbox_setup import open_sandbox
from grs_agents.sandbox.protocol.report import TestReport
from grs_agents.sim.arms.arm_files import ROBOT_FOLDER, check_foreign_robot, find_arm_file

if TYPE_CHECKING:
    from grs_agents.runs.execution import Views

REMEDY = "name an existing Python file"
_SCENE_FILE = "scene.json"


@dataclass(frozen=True)
class CheckResult:
    """Test report and audit of a program."""

    tests: TestReport | None  # None without tests
    audit: AuditReport

    @property
    def accepted(self) -> bool:
        """True if the tests, if any, pass and the audit accepts the program."""
        return self.audit.accepted and (self.tests is None or self.tests.all_passed)

    @property
    def reason(self) -> str:
        """The reason of a rejection, a single line; empty if accepted."""
        return "" if self.accepted else explain_rejection(self.tests, self.audit)


@dataclass(frozen=True)
class CheckOrder:
    """The program to check, with its references."""

    simulation: Path
    tests: Path | None
    config: Config  # bounds, seeds and limits
    folder: Path  # where instances and recordings are written
    task: Path | None = None  # the task definition as written by a run; without it the wording is not judged
    scene: Path | None = None  # a `scene.json`; without it the program is not compared with a photo
    assets: Path | None = None  # assets of the photo's objects and background, overlaid on the library
    name: str = "task_code"  # alternative module name of the program in the tests
    out: Path | None = None  # new or empty folder for an accepted task, as `grs instances` and the like take it


def check_user_program(
    order: CheckOrder, make_agents: Callable[[Config, EventLog, Path], Agents] = Agents
) -> CheckResult:
    """Run the tests, if any, and audit the program's task instances. Raises InputError: a file cannot be read."""
    simulation = read_text(order.simulation, REMEDY)
    tests = read_text(order.tests, REMEDY) if order.tests else None
    task, original = _read_task_file(order.task) if order.task else (None, None)
    scene = read_scene_description(order.scene) if order.scene else None
    with EventLog(order.folder / "events.jsonl") as log, open_sandbox(order.config) as sandbox:
        services = Services(
            config=order.config,
            log=log,
            agents=make_agents(order.config, log, order.folder),
            policy=load_policy(order.config.policy),
            sandbox=sandbox,
            folder=order.folder,
            assets=order.assets,
        )
        report: TestReport | None = None
        if tests is not None:
            programs = {"simulation": simulation, "tests": tests, "simulation_name": order.name}
            setup = program_tool_settings(scene, services)
            report = services.run_tool("run_tests", seed=order.config.seed, **programs, **setup).report
        audited = AuditedPrograms(simulation, tests, report, task, original, scene, order.name)
        result = CheckResult(report, audit_programs(audited, services))
    if order.out is not None and result.accepted:
        _keep_task(order, result, task, order.out)
    return result


def _keep_task(order: CheckOrder, result: CheckResult, task: TaskDefinition | None, out: Path) -> None:
    """Write programs, task, audit, instances, assets and arm of an accepted check: a task folder."""
    write_text(out / PROGRAM_FILES["simulation"], read_text(order.simulation, REMEDY))
    if order.tests is not None:
        write_text(out / PROGRAM_FILES["tests"], read_text(order.tests, REMEDY))
    if task is not None and order.task is not None:
        written = {**read_json(order.task, REMEDY), **task.as_json(), **result.audit.words_as_json(task.description)}
        write_json(out / "task.json", written)
    write_json(out / "audit.json", result.audit.model_dump(mode="json"))
    for source in (order.folder / "instances", order.folder / ROBOT_FOLDER, order.assets):
        if source is not None and source.is_dir():
            copy_folder(source, out / source.name)


def _read_task_file(file: Path) -> tuple[TaskDefinition, TaskDefinition | None]:
    """Returns: the task of a ``task.json``; the task before its revision, if it was revised."""
    remedy = "name the task.json of a run, or write one with task-name, task-description and assets-used"
    value = read_json(file, remedy)
    revised: dict[str, Any] = value.get("revised") or {}
    try:
        original = TaskDefinition.model_validate(revised["from"]) if revised else None
        return TaskDefinition.model_validate(value), original
    except (ValidationError, KeyError, TypeError) as error:
        problem = error.errors()[0] if isinstance(error, ValidationError) else {"loc": ("revised",), "msg": "no task"}
        raise InputError(f"{file}: {problem['loc'][0]}: {problem['msg']}", remedy) from error


@contextmanager
def open_check_order(
    program: Path,
    tests: Path | None,
    task: Path | None,
    scene: Path | None,
    chosen: EffectiveConfig,
    views: "Views",
    out: Path | None = None,
) -> Generator[CheckOrder]:
    """The order of a check, whose output folder exists within the context.

    Args:
        program: a file, or the folder of a run; tests, task and scene default to those of the run.
        scene: a ``scene.json``, the folder of a run, or a photo, which is comprehended first.
        views: views of the comprehension of a photo.
        out: a new or empty folder for an accepted task.

    Raises:
        InputError: a file cannot be read, the photo was not comprehended, or ``out`` is in use.
    """
    if out is not None and out.exists() and (not out.is_dir() or any(out.iterdir())):
        raise InputError(f"{out} is there and not empty", "name a new folder with --out")
    if program.is_dir():
        run, program = program, program / "simulation.py"
        tests = tests or _path_if_file_exists(run / "test_simulation.py")
        task, scene = task or _path_if_file_exists(run / "task.json"), scene or run
    with tempfile.TemporaryDirectory(prefix="grs-check-") as folder:
        order = CheckOrder(program, tests, chosen.config, Path(folder) / "check", task, name=program.stem, out=out)
        if scene is not None:
            file = _find_or_comprehend_scene(scene, chosen, Path(folder) / "scene", views)
            config = chosen.config
            if (file.parent / "run.json").is_file():  # its robot and seed, unless the user sets them
                recorded = read_record(file.parent).config
                changes: dict[str, Any] = {}
                if chosen.sources.get("robot", "default") == "default":
                    changes["robot"] = find_recorded_robot(file.parent, recorded)
                for key in ("seed", "hand"):
                    if chosen.sources.get(key, "default") == "default":
                        changes[key] = recorded.select_portable().get(key, getattr(config, key))
                config = change_config(config, **changes)
            assets = file.parent.resolve() / "assets"
            order = replace(order, scene=_path_if_file_exists(file), assets=assets, config=config)
        yield order


def _path_if_file_exists(file: Path) -> Path | None:
    return file if file.is_file() else None


def _find_or_comprehend_scene(scene: Path, chosen: EffectiveConfig, out: Path, views: "Views") -> Path:
    """Path of the ``scene.json`` of a run, of the named file, or of a photo comprehended now; its assets lie beside
    it."""
    from grs_agents.runs.execution import execute_run  # with LangGraph, which takes long to import

    if scene.suffix == ".json":
        read_scene_description(scene)
        if (scene.parent / "assets").is_dir():
            check_run_folder(scene.parent / "assets")
        return scene
    if (scene / "run.json").exists():
        read_record(scene)
        return scene / _SCENE_FILE
    config = change_config(chosen.config, graph="scene", record=None, cassette=None)
    ended = execute_run(RunOrder("scene", resolve_scene_path(scene), replace(chosen, config=config), out), views)
    if ended.problem is not None:
        raise ended.problem
    if ended.record.status != "accepted":
        raise InputError(f"{scene} was not comprehended: {ended.record.reason}", "name another scene with --scene")
    return out / _SCENE_FILE


def find_recorded_robot(folder: Path, recorded: RecordedConfig) -> str:
    """The run's arm: a shipped arm, or the run's copy of an arm file; the recorded path is not opened.

    Raises:
        InputError: the run has no copy of its arm file, or a worker cannot load the copy.
    """
    robot = str(recorded.as_json().get("robot", Config().robot))
    copied = find_arm_file(folder, robot)
    if copied == robot and "robot" not in recorded.select_portable():
        raise InputError(
            f"{folder} was made with the arm {robot!r} and has no copy of it", "name the file: GRS_ROBOT=FILE"
        )
    if copied != robot:
        check_foreign_robot(Path(copied))
    return copied
