"""A batch's summary of a run."""

from pathlib import Path
from typing import Any

from pydantic import Field

from grs_agents.base import Frozen
from grs_agents.base.errors import GrsError
from grs_agents.base.foreign.files import read_bytes, read_json
from grs_agents.base.trace.events import MOST_TOTAL, Count, Number, Seconds
from grs_agents.base.trace.log import read_events
from grs_agents.runs.batch.run_process import RunEnd, read_run_record_or_none
from grs_agents.runs.record import RunRecord
from grs_agents.sim.instance.task_instance import TaskInstance, parse_instance_json


class BatchRow(Frozen):
    """A run of a batch; fields of stages that the run did not reach keep their defaults."""

    run: str
    scene: str
    seed: Count
    status: str  # of the run; `killed` or `failed` without a record
    reason: str
    task: str = ""
    description: str = ""
    family: str = ""  # first word of its name: the verb, which the audit's judge has compared with the goals
    goals: tuple[str, ...] = ()  # of the first task instance, without coordinates
    repeats: str = ""  # an earlier run of the same scene with the same goals or name
    reward: Number | None = None  # mean of the oracle's over the audit's seeds
    objects: Count = 0
    matched: Count = 0
    moved: Count = 0
    code_fixes: Count = 0
    test_fixes: Count = 0
    task_fixes: Count = 0
    model_calls: Count = 0
    input_tokens: Count = 0
    output_tokens: Count = 0
    # US dollars, as far as reported by the provider
    cost: float = Field(default=0.0, ge=0, le=MOST_TOTAL, allow_inf_nan=False)
    seconds: Seconds = 0.0


def make_batch_row(end: RunEnd) -> BatchRow:
    """Summarise an ended run from its folder; a run with damaged files is a failed run."""
    job, record = end.job, read_run_record_or_none(end.job.folder)
    status, reason = "killed" if end.exit_status is None else "failed", end.error
    if record is not None:
        try:
            return _summarize_record(end, record)
        except GrsError as error:
            status, reason = "failed", f"{job.folder} is damaged: {error}"
    return BatchRow(run=job.name, scene=job.scene, seed=job.seed, status=status, reason=reason)


def _summarize_record(end: RunEnd, record: RunRecord) -> BatchRow:
    """Raises InputError: the task or its first instance is damaged."""
    job, counts = end.job, record.counts
    file = job.folder / "task.json"
    task: dict[str, Any] = read_json(file, "run again") if file.is_file() else {}
    name = str(task.get("task-name", ""))
    instances = sorted((job.folder / "instances").glob("seed_*.json"))
    goals = describe_goals(parse_instance_json(read_bytes(instances[0], "run again"))) if instances else ()
    try:
        events = read_events(job.folder / "events.jsonl")
    except GrsError:  # the run was stopped before its first event
        events = []
    return BatchRow(
        run=job.name,
        scene=job.scene,
        seed=job.seed,
        status=record.status,
        reason=record.reason or end.error,
        task=name,
        description=str(task.get("task-description", "")),
        family=name.split("-", 1)[0],
        goals=goals,
        reward=round(sum(record.rewards) / len(record.rewards), 4) if record.rewards else None,
        objects=counts.get("objects", 0),
        matched=counts.get("objects_matched", 0),
        moved=counts.get("objects_moved", 0),
        code_fixes=counts.get("code_fixes", 0),
        test_fixes=counts.get("test_fixes", 0),
        task_fixes=counts.get("task_fixes", 0),
        model_calls=counts.get("model_calls", 0),
        input_tokens=counts.get("input_tokens", 0),
        output_tokens=counts.get("output_tokens", 0),
        cost=round(sum(event.cost or 0.0 for event in events if event.kind == "reply"), 6),
        seconds=record.seconds.get("total", 0.0),
    )


def describe_goals(instance: TaskInstance) -> tuple[str, ...]:
    """Each goal as text with its kind, moved objects and reference, e.g. `in_zone A -> B`, sorted; poses are left
    out."""
    assets = {item.id: Path(item.asset).stem for item in instance.objects}
    goals: list[str] = []
    for goal in instance.goals:
        names = [assets.get(number, "?") for number in goal.objects]
        moved = " ".join(names if goal.relation is not None else sorted(names))
        if goal.relation is None:
            goals.append(f"{goal.metric} {moved}")
        else:
            reference = goal.relation.reference
            place = "" if reference is None else f" -> {assets.get(reference, '?')}"
            goals.append(f"{goal.relation.kind} {moved}{place}")
    return tuple(sorted(goals))
