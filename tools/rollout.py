"""Run the trusted oracle on a task instance and score it; no generated code is involved."""

import base64
from collections.abc import Callable, Sequence
from functools import cache
from pathlib import Path
from typing import Annotated, Any

from pydantic import Field

from grs_agents.base import Frozen
from grs_agents.base.config.schema import Limits
from grs_agents.base.errors import GrsError
from grs_agents.base.files import write_bytes
from grs_agents.library.library import Library
from grs_agents.sandbox.protocol.report import CallResult
from grs_agents.toolkit import ToolContext, ToolRequest, list_folders_to_read, open_library


class Job(ToolRequest):
    """An instance to solve."""

    instance: dict[str, Any]
    """A ``TaskInstance`` as JSON."""
    recording: str | None = None
    """An .npz file to write the motion to, or None."""
    trials: Annotated[int, Field(ge=0, le=20)] = 0
    """How often to solve it again with a gripper that misses by at most 5 mm."""


class Request(Job):
    """What to run."""

    library_roots: tuple[str, ...] = ()
    """Asset folders, later ones win; none means the library shipped with GRS."""
    more: Annotated[tuple[Job, ...], Field(max_length=1000)] = ()
    """More instances, which the same process solves afterwards: their assets are read once."""


class Outcome(Frozen):
    """What came of an instance.

    Attributes:
        rollout: a ``Rollout`` as JSON, None if the run itself failed.
        outcome: ``ok``, or how the sandbox ended it.
        error: one line, when it failed.
    """

    rollout: dict[str, Any] | None
    outcome: str = "ok"
    error: str = ""


class Result(Outcome):
    """What came of it.

    Attributes:
        more: what came of each of the further instances.
    """

    more: tuple[Outcome, ...] = ()


def run(request: Request, context: ToolContext) -> Result:
    """Run the oracle in the sandbox; where a process that solves several is stopped, each has one of its own."""
    jobs = [Job.model_validate(request.model_dump(include=set(Job.model_fields))), *request.more]
    outcomes = _solve_in_one_process(jobs, request.library_roots, context)
    if len(jobs) > 1 and outcomes[0].outcome not in ("ok", "error"):
        outcomes = [_solve_in_one_process([job], request.library_roots, context)[0] for job in jobs]
    return Result(**outcomes[0].model_dump(), more=tuple(outcomes[1:]))


def _solve_in_one_process(jobs: Sequence[Job], library_roots: Sequence[str], context: ToolContext) -> list[Outcome]:
    """The outcome of each; that of the call for all where it was stopped."""
    reads = [list_folders_to_read(library_roots, str(job.instance.get("robot", ""))) for job in jobs]
    count, limits = len(jobs), context.limits
    several = {name: getattr(limits, name) * count for name in ("wall_seconds", "cpu_seconds", "output_mib")}
    frame = {
        "jobs": [job.model_dump(mode="json") for job in jobs],
        "library_roots": list(library_roots),
        "limits": limits.model_dump(mode="json"),
    }
    call: CallResult = context.sandbox.call(
        "rollout", frame, limits.model_copy(update=several), [path for row in reads for path in row]
    )
    if call.value is None:
        return [Outcome(rollout=None, outcome=call.outcome, error=call.error) for _ in jobs]
    outcomes: list[Outcome] = []
    for job, value in zip(jobs, call.value["outcomes"], strict=True):
        motion = value.pop("motion")
        if job.recording is not None and motion is not None:
            write_bytes(Path(job.recording), base64.b64decode(motion))
        outcomes.append(Outcome.model_validate(value))
    return outcomes


def inside(request: dict[str, Any]) -> dict[str, Any]:
    """The worker's part: an ``Outcome`` for each instance, and the .npz file as base64, since a worker reaches no file
    of the host."""
    limits, open_once = Limits.model_validate(request["limits"]), cache(lambda: open_library(request["library_roots"]))
    return {"outcomes": [_solve(Job.model_validate(job), open_once, limits) for job in request["jobs"]]}


def _solve(job: Job, open_once: Callable[[], Library], limits: Limits) -> dict[str, Any]:
    from grs_agents import sim

    recording = Path("motion.npz")
    try:
        library = open_once()
        instance = sim.TaskInstance.model_validate(job.instance)
        sim.set_environment_defaults(library, instance.seed, instance.robot, limits, hand=instance.hand)
        done = sim.rollout(instance, library, recording if job.recording else None, job.trials)
    except (GrsError, ValueError) as error:
        return {**Outcome(rollout=None, outcome="error", error=str(error)).model_dump(mode="json"), "motion": None}
    motion = base64.b64encode(recording.read_bytes()).decode() if done.recording else None
    rollout = {**done.model_dump(mode="json"), "recording": job.recording if done.recording else None}
    return {**Outcome(rollout=rollout).model_dump(mode="json"), "motion": motion}
