"""``run.json``: what a run was, how it went and what it cost."""

import os
import platform
from collections import Counter
from collections.abc import Mapping, Sequence
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any, Literal

from pydantic import Field, ValidationError

from grs_agents.base import Frozen
from grs_agents.base.config.recorded import RecordedConfig
from grs_agents.base.errors import InputError
from grs_agents.base.files import write_json
from grs_agents.base.foreign.files import check_json_limits, read_bytes
from grs_agents.base.foreign.run_folder import check_run_folder
from grs_agents.base.questions import Question
from grs_agents.base.trace.events import Event
from grs_agents.base.version import __version__

Status = Literal["running", "accepted", "rejected", "failed", "interrupted", "waiting"]
PACKAGES = "mujoco langgraph langchain-core rerun-sdk numpy opencv-python-headless pydantic trimesh"
EXIT_STATUS = {"accepted": 0, "rejected": 1}
"""The verdicts, each with what the command returns."""
FILE = "run.json"
MOST_BYTES = 1 << 20
"""Of ``run.json``; the sample run has 3 kilobytes."""
REMEDY = "name a folder that `grs run` wrote"


class RunRecord(Frozen):
    """The record of one run."""

    id: str
    status: Status
    reason: str = ""  # why, in one line
    question: Question | None = None  # what a run that is `waiting` waits for
    exit_status: int | None = None  # what the command returned; `None` while running
    command: str  # `run`, `scene` or `check`
    source: str  # the scene folder or the program
    graph: str  # the topology
    config: RecordedConfig  # the effective configuration of the last attempt
    versions: dict[str, str]  # of GRS, Python and the packages that matter
    seeds: tuple[int, ...]  # the seeds of the audit
    sandbox: str = ""  # the backend that isolated generated code
    counts: dict[str, int] = Field(default_factory=dict)  # objects, fixes, model calls, tokens
    cost: float | None = None  # US dollars of all model calls; `None` where a provider did not tell its price
    rewards: tuple[float, ...] = ()  # the trusted oracle's reward for each seed
    seconds: dict[str, float] = Field(default_factory=dict)  # wall seconds by stage, and `total`
    attempts: int = 1  # how often the run was started or resumed

    def write(self, folder: Path) -> "RunRecord":
        """Write ``run.json`` whole; on a full disk over the old record, which must not go on saying ``running``."""
        try:
            write_json(folder / FILE, self.model_dump(mode="json"), durable=True)
        except InputError:
            if not (folder / FILE).is_file():
                raise
            (folder / FILE).write_text(self.model_dump_json(), encoding="utf-8")
        return self


def read_record(folder: Path) -> RunRecord:
    """Open a run folder, which may come from somebody else: look at all that is in it, then read ``run.json``.

    Every verb that reads a run begins here.

    Raises:
        InputError: the folder holds no run, its record is damaged, or something in it is no regular file, leads out
            of the folder or is too large.
    """
    file = folder / FILE
    if not os.path.lexists(file):
        raise InputError(f"{folder} holds no run: there is no {FILE} in it", REMEDY)
    check_run_folder(folder)
    data = read_bytes(file, REMEDY, MOST_BYTES)
    check_json_limits(data, file)
    try:
        return RunRecord.model_validate_json(data)
    except ValidationError as error:
        raise InputError(f"{file} is not a run record: {error.errors()[0]['msg']}", REMEDY) from error


def installed_versions() -> dict[str, str]:
    """The versions that a result depends on."""
    installed = {"grs-agents": __version__, "python": platform.python_version(), "platform": platform.platform()}
    for package in PACKAGES.split():
        try:
            installed[package] = version(package)
        except PackageNotFoundError:
            installed[package] = "not installed"
    return installed


def seconds_by_stage(events: Sequence[Event]) -> dict[str, float]:
    """Wall seconds of each node, summed over its visits, with their total."""
    seconds: dict[str, float] = {}
    for event in events:
        if event.kind == "node_ended":
            seconds[event.node] = seconds.get(event.node, 0.0) + event.seconds
    rounded = {name: round(value, 3) for name, value in seconds.items()}
    return {**rounded, "total": round(sum(seconds.values()), 3)}


def sum_reply_costs(events: Sequence[Event]) -> float | None:
    """US dollars of all model calls; None where there were none, or one has no price."""
    costs = [event.cost for event in events if event.kind == "reply"]
    known = [cost for cost in costs if cost is not None]
    return round(sum(known), 6) if costs and len(known) == len(costs) else None


def count_run_results(events: Sequence[Event], state: Mapping[str, Any]) -> dict[str, int]:
    """What was seen, kept, made and spent."""
    replies = [event for event in events if event.kind == "reply"]
    kinds = Counter(event.node for event in events if event.kind == "node_ended")
    scene: dict[str, Any] = state.get("scene", {})
    task: dict[str, Any] = state.get("task", {})
    audit: dict[str, Any] = state.get("audit", {})
    objects: list[dict[str, Any]] = scene.get("objects", [])
    rollouts: list[dict[str, Any]] = audit.get("rollouts", [])
    return {
        "candidates": len(state.get("candidates", [])),
        "objects": len(objects),
        "objects_matched": sum(bool(item["matched"]) for item in objects),
        "objects_reachable": sum(bool(item["reachable"]) for item in objects),
        "assets_used": len(task.get("assets-used", [])),
        "objects_moved": min((len(rollout["moved"]) for rollout in rollouts), default=0),
        "code_fixes": kinds["fix_code"],
        "test_fixes": kinds["fix_tests"],
        "task_fixes": kinds["fix_task"],
        "model_calls": len(replies),
        "input_tokens": sum(event.input_tokens for event in replies),
        "output_tokens": sum(event.output_tokens for event in replies),
    }
