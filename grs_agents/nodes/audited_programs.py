"""What an audit is given."""

from dataclasses import dataclass

from grs_agents.agents import TaskDefinition
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
    name: str = "task_code"  # another module name that the tests may import the program by
