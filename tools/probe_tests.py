"""Run a test suite several times, on the task instance that was audited and on mutants of it: has it teeth?"""

from typing import Annotated, Any, Literal

from pydantic import Field

from grs_agents.base import Frozen
from grs_agents.base.config.schema import Limits
from grs_agents.sandbox.harness.channel import report_progress
from grs_agents.sandbox.harness.suite_probe import run_suite_once
from grs_agents.sandbox.host.batch_calls import BatchResult, call_tool_for_each_item
from grs_agents.sandbox.host.suite_discovery import discover_tests, parse_program
from grs_agents.sandbox.protocol.tracebacks import TESTS_FILE
from grs_agents.sim import InstanceObject
from grs_agents.toolkit import ToolContext, ToolRequest, list_folders_to_read, open_library


class ProbeRun(Frozen):
    """One run of the suite.

    Attributes:
        name: its own among the runs.
        instance: the audited task instance, as JSON; its seed is the one that the run draws.
        mutant: the instance that is put in its place, as JSON; None for none.
        coin: seeds what the tests draw.
        early: whether before the first scene stands, too.
        undo: whether all is put back once the goals are met, before the tests can look.
    """

    name: str
    instance: dict[str, Any]
    mutant: dict[str, Any] | None = None
    coin: Annotated[int, Field(ge=0, lt=2**32)] = 0
    early: bool = False
    undo: bool = False


class Request(ToolRequest):
    """The two programs and the runs."""

    simulation: str
    """Source of the simulation program."""
    tests: str
    """Source of its unit tests, which import the program as ``task_code``."""
    runs: tuple[ProbeRun, ...]
    """The runs, in their order."""
    simulation_name: str = "task_code"
    """Another module name the tests may import the program by."""
    library_roots: tuple[str, ...] = ()
    """Asset folders, later ones win; none means the library shipped with GRS."""
    robot: str = "ur5e"
    """``ur5e``, ``panda`` or the path of an MJCF file."""
    hand: str = "suction"
    """``suction``, ``franka_hand`` or ``robotiq_2f85``."""
    background: str | None = None
    """Library name of what stands fixed around the robot."""
    bystanders: tuple[InstanceObject, ...] = ()
    """What the photo shows, which stands on the table before the program sets its scene up."""


class Outcome(Frozen):
    """What came of one run.

    Attributes:
        name: of the run.
        ended: how: ``passed``, ``failed`` (a test did), ``stopped`` (the process was, or reported out of turn), or
            ``not_run`` after an earlier one was stopped.
        test: the test that ended it.
        message: why, one line.
        solved: episodes at full reward whose scene was the audited instance.
        difference: how the last scene that the tests set up differed from it; empty where it did not.
        replaced: a method of the runtime that the tests replaced; empty for none.
        held: whether every episode ended as the audited instance's goals ask.
    """

    name: str
    ended: Literal["passed", "failed", "stopped", "not_run"]
    test: str = ""
    message: str = ""
    solved: Annotated[int, Field(ge=0)] = 0
    difference: str = ""
    replaced: str = ""
    held: bool = False


class Result(Frozen):
    """All runs.

    Attributes:
        outcomes: one for each run, in their order.
        cpu_seconds: processor time of all workers.
    """

    outcomes: tuple[Outcome, ...]
    cpu_seconds: float


def run(request: Request, context: ToolContext) -> Result:
    """Run them in the sandbox; whatever the programs do is in the result."""
    tests = discover_tests(parse_program(request.tests, TESTS_FILE)).ids
    asked = {**request.model_dump(mode="json"), "tests_run": tests, "limits": context.limits.model_dump(mode="json")}
    names = [one.name for one in request.runs]
    reads = list_folders_to_read(request.library_roots, request.robot)
    batch = call_tool_for_each_item(
        context.sandbox, "probe_tests", asked, names, context.limits, lambda call: True, readable=reads
    )
    cpu = sum(call.cpu_seconds for call in batch.calls)
    return Result(outcomes=tuple(_read_probe_outcome(name, batch) for name in names), cpu_seconds=cpu)


def _read_probe_outcome(name: str, batch: BatchResult) -> Outcome:
    event = batch.ended.get(name)
    if event is None and name not in batch.stopped:
        return Outcome(name=name, ended="not_run", message=f"not run: {batch.last_call.outcome}")
    if event is None or name in batch.repeated or name in batch.untimely:
        return Outcome(name=name, ended="stopped", message=batch.stopped.get(name, batch.last_call).outcome)
    kept = {key: event[key] for key in event.keys() & Outcome.model_fields.keys() - {"name", "ended"}}
    try:
        return Outcome(name=name, ended="passed" if event.get("passed") is True else "failed", **kept)
    except ValueError:
        return Outcome(name=name, ended="stopped", message="malformed")


def inside(request: dict[str, Any]) -> dict[str, Any]:
    """The worker's part: each run is an item."""
    from grs_agents import sim
    from grs_agents.sim.cliport import import_hook

    import_hook.install()
    limits, library = Limits.model_validate(request["limits"]), open_library(request["library_roots"])
    asked = {one["name"]: ProbeRun.model_validate(one) for one in request["runs"]}
    bystanders = [sim.InstanceObject.model_validate(item) for item in request["bystanders"]]
    around = (request["robot"], limits, request["background"], bystanders, request["hand"])
    memory = sim.EpisodeMemory()
    report, run_suite, finish = report_progress, run_suite_once, sim.Probe.finish_and_report
    for item in request["items"]:
        report({"item": item, "phase": "start"})
        one = asked[item]
        instance = sim.TaskInstance.model_validate(one.instance)
        mutant = None if one.mutant is None else sim.TaskInstance.model_validate(one.mutant)
        sim.set_environment_defaults(library, instance.seed, *around)
        probe = sim.Environment.witness = sim.Probe(instance, mutant, one.coin, one.early, memory, one.undo)

        def begin_test(probe: sim.Probe = probe) -> None:
            probe.begin_test()
            sim.reset_before_test()

        programs = (request["simulation"], request["tests"], request["simulation_name"])
        event = run_suite(*programs, request["tests_run"], instance.seed, begin_test)
        report({"item": item, "phase": "end", **event, **finish(probe)})
    return {}
