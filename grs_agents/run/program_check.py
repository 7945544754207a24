"""Check a simulation program of the user's: the same sandbox, tests, instances, oracle and audit, without a model."""

from dataclasses import dataclass
from pathlib import Path

from grs_agents.agents import Agents
from grs_agents.audit import AuditReport
from grs_agents.config import Config
from grs_agents.foreign import read_text
from grs_agents.nodes import AuditedPrograms, Services, audit_programs
from grs_agents.perception import read_scene_description
from grs_agents.policies import load_policy
from grs_agents.run.sandbox_setup import open_sandbox
from grs_agents.sandbox import TestReport
from grs_agents.trace import EventLog

REMEDY = "name an existing Python file"


@dataclass(frozen=True)
class CheckOrder:
    """What to check."""

    simulation: Path
    tests: Path | None
    config: Config  # bounds, seeds and limits
    folder: Path  # where instances and recordings are written
    run: Path | None = None  # a run whose own assets the program may use, and whose background is put around it


def check_user_program(order: CheckOrder) -> tuple[TestReport | None, AuditReport]:
    """Run the tests, if any, and audit the program's task instances. Raises InputError: a file cannot be read."""
    simulation = read_text(order.simulation, REMEDY)
    tests = read_text(order.tests, REMEDY) if order.tests else None
    with EventLog(order.folder / "events.jsonl") as log, open_sandbox(order.config) as sandbox:
        services = Services(
            config=order.config,
            log=log,
            agents=Agents(config=order.config, log=log, folder=order.folder),
            policy=load_policy(order.config.policy),
            sandbox=sandbox,
            folder=order.folder,
            assets=order.run.resolve() / "assets" if order.run else None,
        )
        report: TestReport | None = None
        if tests is not None:
            report = services.run_tool(
                "run_tests",
                simulation=simulation,
                tests=tests,
                simulation_name=order.simulation.stem,
                library_roots=[str(root) for root in services.library.roots],
                robot=services.robot_name_or_path,
                seed=order.config.seed,
            ).report
        photo = order.run / "scene.json" if order.run else None
        scene = read_scene_description(photo) if photo and photo.is_file() else None
        audited = AuditedPrograms(simulation=simulation, tests=tests, report=report, scene=scene)
        return report, audit_programs(audited, services)
