"""``run.json``: inputs, outcome and cost of a run."""

import os
import platform
from collections import Counter
from collections.abc import Mapping, Sequence
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any, Literal

from pydantic import Field, ValidationError

from grs_agents.audit.types import JudgedWords
from grs_agents.base import Frozen
from grs_agents.base.config.recorded import RecordedConfig
from grs_agents.base.errors import InputError
from grs_agents.base.files import write_json
from grs_agents.base.foreign.files import check_json_limits, read_bytes
from grs_agents.base.foreign.run_folder import check_run_folder
from grs_agents.base.questions import Question
from grs_agents.base.trace.events import MOST_TOTAL, Count, Event, Number, Seconds
from grs_agents.base.version import __version__

Status = Literal["running", "accepted", "rejected", "failed", "interrupted", "waiting"]
PACKAGES = "mujoco langgraph langchain-core rerun-sdk numpy opencv-python-headless pydantic trimesh"
EXIT_STATUS = {"accepted": 0, "rejected": 1}
"""Verdicts with the exit status of the command."""
FILE = "run.json"
MOST_BYTES = 1 << 20
"""Largest ``run.json``; the sample run has 3 kilobytes."""
REMEDY = "name a folder that `grs run` wrote"


class RunRecord(Frozen):
    """The record of a run."""

    id: str
    status: Status
    reason: str = ""  # of the status, a single line
    question: Question | None = None  # of a `waiting` run
    exit_status: int | None = Field(default=None, ge=0, le=255)  # of the command; `None` while running
    command: str  # `run`, `scene` or `check`
    source: str  # the scene folder or the program
    graph: str  # the topology
    config: RecordedConfig  # the effective configuration of the last attempt
    versions: dict[str, str]  # of GRS, Python and the packages that matter
    seeds: tuple[Count, ...]  # the seeds of the audit
    sandbox: str = ""  # the backend that isolated generated code
    counts: dict[str, Count] = Field(default_factory=dict)  # objects, fixes, model calls, tokens
    # US dollars of all model calls; `None` if a price is unknown
    cost: float | None = Field(default=None, ge=0, le=MOST_TOTAL, allow_inf_nan=False)
    # statement of the goals by GRS, and verdict on the author's words; none where the audit failed
    sentence: str = ""
    words: JudgedWords | None = None
    edits: tuple[str, ...] = ()  # of a person who corrected the scene, in words
    rewards: tuple[Number, ...] = ()  # the trusted oracle's reward for each seed
    seconds: dict[str, Seconds] = Field(default_factory=dict)  # wall seconds by stage, and `total`
    attempts: Count = 1  # number of starts and resumptions

    def write(self, folder: Path) -> "RunRecord":
        """Write ``run.json`` atomically; on a full disk over the old record, which would otherwise stay ``running``."""
        try:
            write_json(folder / FILE, self.model_dump(mode="json"), durable=True)
        except InputError:
            if not (folder / FILE).is_file():
                raise
            (folder / FILE).write_text(self.model_dump_json(), encoding="utf-8")
        return self


def read_record(folder: Path) -> RunRecord:
    """Validate all of a run folder, which may be foreign, then read ``run.json``; every verb that reads a run begins
    here.

    Raises:
        InputError: the folder holds no run, its record is damaged, or an entry is no regular file, leads out of the
            folder or is too large.
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
    """Versions on which a result depends."""
    installed = {"grs-agents": __version__, "python": platform.python_version(), "platform": platform.platform()}
    for package in PACKAGES.split():
        try:
            installed[package] = version(package)
        except PackageNotFoundError:
            installed[package] = "not installed"
    return installed


def seconds_by_stage(events: Sequence[Event]) -> dict[str, float]:
    """Wall seconds of each node, summed over its visits, with their total."""
    seconds: dict[str, Seconds] = {}
    for event in events:
        if event.kind == "node_ended":
            seconds[event.node] = seconds.get(event.node, 0.0) + event.seconds
    rounded = {name: round(value, 3) for name, value in seconds.items()}
    return {**rounded, "total": round(sum(seconds.values()), 3)}


def sum_reply_costs(events: Sequence[Event]) -> float | None:
    """US dollars of all model calls; None without calls, or if a price is unknown."""
    costs = [event.cost for event in events if event.kind == "reply"]
    known = [cost for cost in costs if cost is not None]
    return round(sum(known), 6) if costs and len(known) == len(costs) else None


def count_run_results(events: Sequence[Event], state: Mapping[str, Any]) -> dict[str, int]:
    """Counts of objects, fixes, model calls and tokens."""
    replies = [event for event in events if event.kind == "reply"]
    kinds = Counter(event.node for event in events if event.kind == "node_ended")
    scene: dict[str, Any] = state.get("scene", {})
    task: dict[str, Any] = state.get("task", {})
    audit: dict[str, Any] = state.get("audit", {})
    objects: list[dict[str, Any]] = scene.get("objects", [])
    rollouts: list[dict[str, Any]] = audit.get("rollouts", [])
    return {
        "candidates": len(state.get("objects", [])),
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
