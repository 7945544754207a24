"""The audit of two programs: trusted code measures them, then every check judges what was measured."""

from dataclasses import dataclass

from grs_agents.agents import TaskDefinition
from grs_agents.audit import AuditReport, Finding, audit_task
from grs_agents.nodes.services import Services
from grs_agents.nodes.task_instances import solve_task_instances
from grs_agents.perception import SceneDescription
from grs_agents.sandbox import TestReport


@dataclass(frozen=True)
class AuditedPrograms:
    """What is audited, and what it is measured against."""

    simulation: str  # source of the simulation program
    tests: str | None = None  # source of its tests, if there are any
    report: TestReport | None = None  # of those tests
    task: TaskDefinition | None = None  # None: no words are given
    original: TaskDefinition | None = None  # the task before it was revised
    scene: SceneDescription | None = None  # the photo; None: the program need not keep to one


def audit_programs(audited: AuditedPrograms, services: Services) -> AuditReport:
    """Instantiate the program for each seed, let the trusted oracle solve the instances, and judge."""
    measured = solve_task_instances(
        audited.simulation, services, audited.scene.background if audited.scene is not None else None
    )
    further: list[Finding] = []
    return audit_task(
        measured.instances,
        measured.failures,
        measured.rollouts,
        services.config.audit,
        services.library,
        audited.task,
        audited.scene,
        audited.original,
        further,
    )
