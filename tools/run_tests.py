"""Run a generated test program against a generated simulation program and report every test."""

from typing import Any

from pydantic import Field

from grs_agents.base import Frozen
from grs_agents.base.config.schema import Limits
from grs_agents.sandbox.harness.suite_runner import run_tests_inside
from grs_agents.sandbox.host.suite_run import TestRun, run_tests
from grs_agents.sandbox.protocol.report import TestReport
from grs_agents.sim import InstanceObject
from grs_agents.toolkit import ToolContext, ToolRequest, list_folders_to_read, open_library


class Request(ToolRequest):
    """The two programs."""

    simulation: str
    """Source of the simulation program."""
    tests: str
    """Source of its unit tests, which import the program as ``task_code``."""
    simulation_name: str = "task_code"
    """Another module name the tests may import the program by."""
    library_roots: tuple[str, ...] = ()
    """Asset folders, later ones win; none means the library shipped with GRS."""
    robot: str = "ur5e"
    """``ur5e``, ``panda`` or the path of an MJCF file."""
    hand: str = "suction"
    """``suction``, ``franka_hand`` or ``robotiq_2f85``."""
    background: str | None = None
    """Library name of what stands fixed around the robot, so that nothing is placed in it."""
    bystanders: tuple[InstanceObject, ...] = ()
    """What the photo shows, which stands on the table before the program sets its scene up."""
    seed: int = Field(default=0, ge=0, lt=2**32)
    """Seeds ``random`` and ``numpy.random`` before each test."""


class Result(Frozen):
    """What became of the tests."""

    report: TestReport


def run(request: Request, context: ToolContext) -> Result:
    """Run the tests in the sandbox; whatever the programs do is in the report."""
    programs = TestRun(
        simulation=request.simulation,
        tests=request.tests,
        simulation_name=request.simulation_name,
        seed=request.seed,
        clear="grs_agents.sim:reset_before_test",
        episode="grs_agents.sim:last_episode",
        limit="grs_agents.sim:describe_reached_limit",
        extra={
            "library_roots": request.library_roots,
            "robot": request.robot,
            "hand": request.hand,
            "background": request.background,
            "bystanders": [item.model_dump(mode="json") for item in request.bystanders],
            "limits": context.limits.model_dump(mode="json"),
        },
    )
    reads = list_folders_to_read(request.library_roots, request.robot)
    return Result(report=run_tests(context.sandbox, "run_tests", programs, context.limits, reads))


def inside(request: dict[str, Any]) -> dict[str, Any]:
    """The worker's part."""
    from grs_agents import sim
    from grs_agents.sim.cliport import import_hook

    import_hook.install()
    extra = request["extra"]
    limits = Limits.model_validate(extra["limits"])
    library, background = open_library(extra["library_roots"]), extra["background"]
    bystanders = [sim.InstanceObject.model_validate(item) for item in extra["bystanders"]]
    around = (extra["robot"], limits, background, bystanders, extra["hand"])
    sim.set_environment_defaults(library, request["seed"], *around)
    sim.Environment.witness = sim.EpisodeReplay(sim.EpisodeMemory())  # most tests run the same episode
    return run_tests_inside(request)
