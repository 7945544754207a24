"""Check a simulation program outside a run: the same sandbox, tests, instances, oracle and audit."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from grs_agents.agents import Agents, TaskDefinition
from grs_agents.audit import AuditReport
from grs_agents.config import Config
from grs_agents.errors import InputError
from grs_agents.foreign import read_json, read_text
from grs_agents.nodes import AuditedPrograms, Services, audit_programs, setup_of_programs
from grs_agents.perception import read_scene_description
from grs_agents.policies import load_policy
from grs_agents.run.sandbox_setup import open_sandbox
from grs_agents.sandbox import TestReport
from grs_agents.trace import EventLog

REMEDY = "name an existing Python file"


@dataclass(frozen=True)
class CheckOrder:
    """What to check, and against what."""

    simulation: Path
    tests: Path | None
    config: Config  # bounds, seeds and limits
    folder: Path  # where instances and recordings are written
    task: Path | None = None  # the task definition, as a run writes it; without one the words are not judged
    scene: Path | None = None  # a `scene.json`; without one the program need not keep to a photo
    assets: Path | None = None  # what stands for the photo's objects and its background, laid over the library
    name: str = "task_code"  # another module name that the tests may import the program by


def check_user_program(
    order: CheckOrder, make_agents: Callable[[Config, EventLog, Path], Agents] = Agents
) -> tuple[TestReport | None, AuditReport]:
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
            setup = setup_of_programs(scene, services)
            report = services.run_tool("run_tests", seed=order.config.seed, **programs, **setup).report
        audited = AuditedPrograms(simulation, tests, report, task, original, scene, order.name)
        return report, audit_programs(audited, services)


def _read_task_file(file: Path) -> tuple[TaskDefinition, TaskDefinition | None]:
    """The task in a ``task.json``, and the one before it was revised, if it was. Raises InputError: it holds none."""
    remedy = "name the task.json of a run, or write one with task-name, task-description and assets-used"
    value = read_json(file, remedy)
    revised: dict[str, Any] = value.get("revised") or {}
    try:
        original = TaskDefinition.model_validate(revised["from"]) if revised else None
        return TaskDefinition.model_validate(value), original
    except (ValidationError, KeyError, TypeError) as error:
        found = error.errors()[0] if isinstance(error, ValidationError) else {"loc": ("revised",), "msg": "no task"}
        raise InputError(f"{file}: {found['loc'][0]}: {found['msg']}", remedy) from error
