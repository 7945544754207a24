"""What a batch tells of one run."""

from pathlib import Path
from typing import Any

from grs_agents.base import Frozen
from grs_agents.base.errors import GrsError
from grs_agents.base.foreign.files import read_bytes, read_json
from grs_agents.base.trace.log import read_events
from grs_agents.runs.batch.run_process import RunEnd, read_run_record_or_none
from grs_agents.sim.instance.task_instance import TaskInstance, parse_instance_json


class BatchRow(Frozen):
    """One run of a batch; all but the first five fields are empty where the run did not get so far."""

    run: str
    scene: str
    seed: int
    status: str  # of the run; `killed` or `failed` where it left no record
    reason: str
    task: str = ""
    description: str = ""
    family: str = ""  # what its name begins with: the verb, which the audit's judge has compared with the goals
    goals: tuple[str, ...] = ()  # of the first task instance: what is to be where, without coordinates
    repeats: str = ""  # the run of the same scene that has the same goals, if an earlier one has
    reward: float | None = None  # mean of the oracle's over the audit's seeds
    objects: int = 0
    matched: int = 0
    moved: int = 0
    code_fixes: int = 0
    test_fixes: int = 0
    task_fixes: int = 0
    model_calls: int = 0
    input_tokens: int = 0
    output_tokens: int = 0
    cost: float = 0.0  # US dollars, as far as the provider tells
    seconds: float = 0.0


def make_batch_row(end: RunEnd) -> BatchRow:
    """What the folder of an ended run tells of it."""
    job, record = end.job, read_run_record_or_none(end.job.folder)
    if record is None:
        status = "killed" if end.exit_status is None else "failed"
        return BatchRow(run=job.name, scene=job.scene, seed=job.seed, status=status, reason=end.error)
    counts = record.counts
    task = _read_task_json_if_any(job.folder)
    name = str(task.get("task-name", ""))
    return BatchRow(
        run=job.name,
        scene=job.scene,
        seed=job.seed,
        status=record.status,
        reason=record.reason or end.error,
        task=name,
        description=str(task.get("task-description", "")),
        family=name.split("-", 1)[0],
        goals=_read_goals(job.folder),
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
        cost=_sum_model_cost(job.folder),
        seconds=record.seconds.get("total", 0.0),
    )


def _read_task_json_if_any(folder: Path) -> dict[str, Any]:
    file = folder / "task.json"
    return read_json(file, "run again") if file.is_file() else {}


def _read_goals(folder: Path) -> tuple[str, ...]:
    """The goals of the first task instance in words of ours, sorted: `in_zone A.urdf -> B.urdf`."""
    files = sorted((folder / "instances").glob("seed_*.json"))
    return describe_goals(parse_instance_json(read_bytes(files[0], "run again"))) if files else ()


def describe_goals(instance: TaskInstance) -> tuple[str, ...]:
    """Each goal by its kind, what it moves and what it refers to, sorted; poses are left out."""
    assets = {item.id: Path(item.asset).stem for item in instance.objects}
    told: list[str] = []
    for goal in instance.goals:
        names = [assets.get(number, "?") for number in goal.objects]
        moved = " ".join(names if goal.relation is not None else sorted(names))
        if goal.relation is None:
            told.append(f"{goal.metric} {moved}")
        else:
            reference = goal.relation.reference
            place = "" if reference is None else f" -> {assets.get(reference, '?')}"
            told.append(f"{goal.relation.kind} {moved}{place}")
    return tuple(sorted(told))


def _sum_model_cost(folder: Path) -> float:
    try:
        events = read_events(folder / "events.jsonl")
    except GrsError:  # a run that was stopped before its first event
        return 0.0
    return round(sum(event.cost or 0.0 for event in events if event.kind == "reply"), 6)
