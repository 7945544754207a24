"""Run the trusted oracle on a task instance and score it; no generated code is involved."""

import base64
from pathlib import Path
from typing import Annotated, Any

from pydantic import Field

from grs_agents.base import Frozen
from grs_agents.config import Limits
from grs_agents.errors import GrsError
from grs_agents.files import write_bytes
from grs_agents.sandbox import CallResult
from grs_agents.toolkit import ToolContext, ToolRequest, list_folders_to_read, open_library


class Request(ToolRequest):
    """What to run."""

    instance: dict[str, Any]
    """A ``TaskInstance`` as JSON."""
    library_roots: tuple[str, ...] = ()
    """Asset folders, later ones win; none means the library shipped with GRS."""
    recording: str | None = None
    """An .npz file to write the motion to, or None."""
    trials: Annotated[int, Field(ge=0, le=20)] = 0
    """How often to solve it again with a gripper that misses by at most 5 mm."""


class Result(Frozen):
    """What came of it.

    Attributes:
        rollout: a ``Rollout`` as JSON, None if the run itself failed.
        outcome: ``ok``, or how the sandbox ended it.
        error: one line, when it failed.
    """

    rollout: dict[str, Any] | None
    outcome: str = "ok"
    error: str = ""


def run(request: Request, context: ToolContext) -> Result:
    """Run the oracle in the sandbox."""
    reads = list_folders_to_read(request.library_roots, str(request.instance.get("robot", "")))
    limits = context.limits.model_dump(mode="json")
    frame = {"request": request.model_dump(mode="json"), "limits": limits}
    call: CallResult = context.sandbox.call("rollout", frame, context.limits, reads)
    if call.value is None:
        return Result(rollout=None, outcome=call.outcome, error=call.error)
    motion = call.value.pop("motion")
    if request.recording is not None and motion is not None:
        write_bytes(Path(request.recording), base64.b64decode(motion))
    return Result.model_validate(call.value)


def inside(request: dict[str, Any]) -> dict[str, Any]:
    """The worker's part: a ``Result``, and the .npz file as base64, since a worker reaches no file of the host."""
    from grs_agents import sim

    asked, limits = Request.model_validate(request["request"]), Limits.model_validate(request["limits"])
    recording = Path("motion.npz")
    try:
        instance = sim.TaskInstance.model_validate(asked.instance)
        library = open_library(asked.library_roots)
        sim.set_environment_defaults(library, instance.seed, instance.robot, limits)
        done = sim.rollout(instance, library, recording if asked.recording else None, asked.trials)
    except (GrsError, ValueError) as error:
        return {**Result(rollout=None, outcome="error", error=str(error)).model_dump(mode="json"), "motion": None}
    motion = base64.b64encode(recording.read_bytes()).decode() if done.recording else None
    rollout = {**done.model_dump(mode="json"), "recording": asked.recording if done.recording else None}
    return {**Result(rollout=rollout).model_dump(mode="json"), "motion": motion}
