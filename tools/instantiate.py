"""Turn a generated simulation program into task instances, one for each seed: typed data instead of code.

Each instance, but for those of ``seeds_drawn_once``, is drawn twice, in two processes and in another order, and counts
only if both are equal. So it belongs to the program and the seed, not to the moment: a program can still hand out any
instance it likes, but always the same.
"""

from collections.abc import Sequence
from typing import Annotated, Any, Final, Literal, get_args

from pydantic import Field, ValidationError

from grs_agents.base import Frozen
from grs_agents.base.config.schema import Limits
from grs_agents.sandbox.harness.captured_error import CapturedError
from grs_agents.sandbox.harness.channel import report_progress
from grs_agents.sandbox.harness.suite_runner import load_program, seed_everything
from grs_agents.sandbox.host.batch_calls import BatchResult, call_tool_for_each_item
from grs_agents.sandbox.host.suite_discovery import parse_program
from grs_agents.sandbox.protocol.report import CallResult
from grs_agents.sandbox.protocol.tracebacks import SIMULATION_FILE, Trace, describe_error, describe_stack_dump
from grs_agents.sim import (
    InstanceError,
    InstanceObject,
    InvalidValueError,
    TaskInstance,
    defines_task_class,
    describe_first_error,
    parse_instance_json,
)
from grs_agents.toolkit import ToolContext, ToolRequest, list_folders_to_read, open_library

Seed = Annotated[int, Field(ge=0, lt=2**32)]
FailureOutcome = Literal[
    "timeout",
    "crashed",
    "memory",
    "not_run",
    "invalid",
    "error",
    "no_free_space",
    "unreachable",
    "target_occupied",
    "target_too_small",
    "nothing_to_do",
    "simulated_step_limit",
    "object_limit",
    "vertex_limit",
    "output_limit",
    "scratch_limit",
    "thread_limit",
    "forged",
    "not_repeatable",
]
_STOPPED: dict[str, FailureOutcome] = {
    "timeout": "timeout",
    "cpu_limit": "timeout",
    "memory_limit": "memory",
    "output_limit": "output_limit",
    "scratch_limit": "scratch_limit",
    "thread_limit": "thread_limit",
    "forged": "forged",
    "error": "error",
}


class Request(ToolRequest):
    """The program and the seeds to draw."""

    simulation: str
    """Source of the simulation program."""
    seeds: Annotated[tuple[Seed, ...], Field(min_length=1, max_length=1000)] = (0, 1, 2)
    """Seeds; one task instance is drawn for each, twice."""
    seeds_drawn_once: Annotated[tuple[Seed, ...], Field(max_length=1000)] = ()
    """More seeds, whose instances need not be repeatable."""
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


_BALLAST: Final = 512
"""Blocks of each kind that are allocated before each seed of the second drawing, of up to as many bytes: Python keeps
small blocks apart by size, and each then lies elsewhere than in the first. Without them the hash of a function came
out the same for 13 of 37 seeds, with them for none."""


class Failure(Frozen):
    """A seed that gave no instance.

    Attributes:
        seed: the seed.
        outcome: ``invalid`` is an instance that breaks its schema, ``forged`` one that did not come from the
            harness or came twice, ``not_repeatable`` one that differs when it is drawn again; the rest as the
            simulation types it.
        message: one line.
        traceback: of the program, without the machinery.
    """

    seed: int
    outcome: FailureOutcome
    message: str
    traceback: str = ""


class Result(Frozen):
    """What the program makes of the seeds.

    Attributes:
        instances: valid task instances as JSON, in the order of their seeds.
        failures: one for each other seed.
        seconds: wall time.
        backend: what separated the program from the host.
    """

    instances: tuple[dict[str, Any], ...]
    failures: tuple[Failure, ...]
    seconds: float
    backend: str


def run(request: Request, context: ToolContext) -> Result:
    """Run the program in the sandbox and check what it yields; whatever it does is in the result."""
    failures = _list_source_failures(request)
    if failures:
        return Result(instances=(), failures=failures, seconds=0.0, backend=context.sandbox.backend)
    seeds = tuple(dict.fromkeys((*request.seeds, *request.seeds_drawn_once)))
    drawn, first = _draw_instances_of_seeds(seeds, request, context)
    calls = first.calls
    if kept := tuple(seed for seed in dict.fromkeys(request.seeds) if isinstance(drawn[seed], TaskInstance)):
        again, second = _draw_instances_of_seeds(_reorder_seeds(kept), request, context, _BALLAST)
        calls += second.calls
        drawn |= {seed: _require_same_instance(drawn[seed], again[seed]) for seed in kept}
    return Result(
        instances=tuple(
            outcome.model_dump(mode="json") for outcome in drawn.values() if isinstance(outcome, TaskInstance)
        ),
        failures=tuple(outcome for outcome in drawn.values() if isinstance(outcome, Failure)),
        seconds=sum(call.seconds for call in calls),
        backend=first.last_call.backend,
    )


def _list_source_failures(request: Request) -> tuple[Failure, ...]:
    """Why the source need not run at all, for each seed; empty if it is Python with a task in it."""
    seeds = (*request.seeds, *request.seeds_drawn_once)
    try:
        tree = parse_program(request.simulation, SIMULATION_FILE)
    except SyntaxError as error:
        trace = describe_error(error)
        return tuple(Failure(seed=seed, outcome="error", **_trace_to_fields(trace)) for seed in seeds)
    if defines_task_class(tree):
        return ()
    message = "the program defines no class that derives from Task: write `class Name(Task):`"
    return tuple(Failure(seed=seed, outcome="error", message=message) for seed in seeds)


def _draw_instances_of_seeds(
    seeds: Sequence[int], request: Request, context: ToolContext, ballast: int = 0
) -> tuple[dict[int, TaskInstance | Failure], BatchResult]:
    """Draw each seed once, in a process that ran nothing before."""
    batch = call_tool_for_each_item(
        context.sandbox,
        "instantiate",
        request.model_dump(mode="json") | {"limits": context.limits.model_dump(mode="json"), "ballast": ballast},
        [str(seed) for seed in seeds],
        context.limits,
        hopeless=lambda call: True,  # what hangs in reset for one seed hangs for all
        readable=list_folders_to_read(request.library_roots, request.robot),
    )
    return {seed: _read_drawn_instance(seed, batch, request.simulation, context.limits) for seed in seeds}, batch


def _reorder_seeds(seeds: Sequence[int]) -> tuple[int, ...]:
    """Backwards, the one in the middle first: none comes as many draws after the beginning as before, so that a program
    which counts them, or keeps something from one to the next, draws something else."""
    middle = len(seeds) // 2 if len(seeds) % 2 else len(seeds)
    return (*seeds[middle : middle + 1], *reversed(seeds[middle + 1 :]), *reversed(seeds[:middle]))


def _require_same_instance(first: TaskInstance | Failure, second: TaskInstance | Failure) -> TaskInstance | Failure:
    """The instance that was drawn twice, or why it does not count."""
    if isinstance(first, Failure) or first == second:
        return first
    if isinstance(second, Failure):
        return second.model_copy(update={"message": f"drawn again: {second.message}"[:1000]})
    differing = [name for name in TaskInstance.model_fields if getattr(first, name) != getattr(second, name)]
    message = (
        f"drawn again in a fresh process and another order, the instance differs in: {', '.join(differing)}; "
        "draw from numpy.random, random or the environment alone, which are seeded"
    )
    return Failure(seed=first.seed, outcome="not_repeatable", message=message)


def inside(request: dict[str, Any]) -> dict[str, Any]:
    """The worker's part: load the program, draw an instance for each seed, report each at once."""
    from grs_agents import sim
    from grs_agents.sim.cliport import import_hook

    import_hook.install()
    library = open_library(request["library_roots"])
    bystanders = [sim.InstanceObject.model_validate(item) for item in request["bystanders"]]
    sim.set_environment_defaults(
        library,
        robot=request["robot"],
        limits=Limits.model_validate(request["limits"]),
        background=request["background"],
        bystanders=bystanders,
        hand=request["hand"],
    )
    ballast = _allocate_blocks(request["ballast"])
    items: Sequence[str] = request["items"]
    task: Any = None
    with CapturedError() as loading:
        seed_everything(0)
        task = sim.find_task_class(load_program(request["simulation"]))
    for item in items:
        report_progress({"item": item, "phase": "start"})
        ballast += _allocate_blocks(request["ballast"])
        seed_everything(int(item))
        sim.reset_before_test()
        event: dict[str, Any] = {"instance": None}
        with CapturedError() as captured:
            if loading.error is not None:
                raise loading.error
            instance = sim.instantiate(task(), int(item), library)
            if (limit := sim.latest_limit_error()) is not None:  # though the program caught it
                raise limit
            event["instance"] = instance.model_dump_json()
        if isinstance(captured.error, MemoryError):
            raise captured.error
        if captured.error is not None:
            event = _format_failure_fields(captured.error)
        report_progress({"item": item, "phase": "end", **event})
    ballast.clear()  # until here it moves what a program allocates, so that no instance can depend on addresses
    return {}


def _allocate_blocks(count: int) -> list[object]:
    return [block for size in range(count) for block in (object(), complex(size), bytes(size))]


def _format_failure_fields(error: BaseException) -> dict[str, str]:
    shown = _trace_to_fields(describe_error(error))
    if isinstance(error, ValidationError | InvalidValueError):
        message = describe_first_error(error) if isinstance(error, ValidationError) else str(error)
        return {**shown, "message": message[:1000], "outcome": "invalid"}
    return {**shown, "outcome": str(getattr(error, "outcome", "error"))}


def _read_drawn_instance(seed: int, batch: BatchResult, source: str, limits: Limits) -> TaskInstance | Failure:
    item = str(seed)
    if item in batch.stopped:
        return _make_failure_of_stopped_call(seed, batch.stopped[item], source)
    event = batch.ended.get(item)
    if item in batch.repeated or item in batch.untimely:
        return Failure(seed=seed, outcome="forged", message="its instance was reported twice, or out of turn")
    if event is None and not batch.last_call.events:
        return _make_failure_of_stopped_call(seed, batch.last_call, source)
    if event is None:
        message = f"an earlier seed used up the limit of {limits.wall_seconds:g} s for all of them"
        return Failure(seed=seed, outcome="not_run", message=message)
    if event.get("instance") is None:
        outcome: Any = event.get("outcome") if event.get("outcome") in get_args(FailureOutcome) else "error"
        message, trace = str(event.get("message", ""))[:1000], str(event.get("traceback", ""))[:8000]
        return Failure(seed=seed, outcome=outcome, message=message, traceback=trace)
    return _validate_instance_json(seed, event["instance"], limits.objects)


def _validate_instance_json(seed: int, text: object, objects: int) -> TaskInstance | Failure:
    if not isinstance(text, str):
        return Failure(seed=seed, outcome="invalid", message=f"the instance is {type(text).__name__}, not JSON as text")
    try:
        checked = parse_instance_json(text, objects)
    except InstanceError as error:
        return Failure(seed=seed, outcome="invalid", message=str(error)[:1000])
    if checked.seed != seed:
        return Failure(seed=seed, outcome="invalid", message=f"the instance says seed {checked.seed}, not {seed}")
    return checked


def _make_failure_of_stopped_call(seed: int, call: CallResult, source: str) -> Failure:
    trace = describe_stack_dump(call.stack, {SIMULATION_FILE: source}, call.error)
    last = (call.error.strip().splitlines() or [call.outcome])[-1][:1000]
    outcome = _STOPPED.get(call.outcome, "crashed")
    return Failure(seed=seed, outcome=outcome, message=last, traceback=trace.text if trace else call.error[-8000:])


def _trace_to_fields(trace: Trace) -> dict[str, str]:
    return {"message": trace.message, "traceback": trace.text}
