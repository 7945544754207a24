"""A batch: runs of many scenes in a folder, resumable and extensible."""

import time
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from itertools import combinations
from pathlib import Path
from typing import Any, Final

from grs_agents.base import content
from grs_agents.base.config.load import load_config
from grs_agents.base.config.schema import ROLES
from grs_agents.base.errors import InputError
from grs_agents.base.files import write_json
from grs_agents.base.foreign.files import path_exists, read_json
from grs_agents.base.ray_cluster import Engine
from grs_agents.base.version import __version__
from grs_agents.models.factory import list_model_variables
from grs_agents.perception.reading.scene_source import short_scene_name
from grs_agents.runs.batch.jobs import run_jobs
from grs_agents.runs.batch.results import BatchResults, write_results
from grs_agents.runs.batch.row import BatchRow, make_batch_row
from grs_agents.runs.batch.run_process import RunEnd, RunJob

_ORDER: Final = "batch.json"
_ROUNDS: Final = 4
"""Rounds of further seeds, as many a round as tasks are missing: about a third of the offline author's tasks are
repetitions, and a scene with few objects allows few tasks."""
_MOST_COMPARED: Final = 1000
"""Tasks whose distances are averaged: 500,000 pairs take half a second."""
_WRITTEN_EVERY: Final = 2.0
"""Interval between writes of the results, s: the files grow with the batch, and a resumed batch reads its runs
anyway."""
Watcher = Callable[[BatchRow], None]


@dataclass(frozen=True)
class BatchOrder:
    """A user's request for a batch."""

    scenes: tuple[str, ...]  # as `grs run` takes them
    out: Path
    tasks: int | None = None  # number of different tasks of each scene; `None`: a single run of each
    seed: int = 0  # of the first run of each scene
    config: Path | None = None
    settings: tuple[str, ...] = ()
    workers: int = 2
    timeout: float = 600  # seconds before a run is killed
    engine: Engine = "local"
    address: str | None = None  # of a Ray cluster


def run_batch(order: BatchOrder, watch: Watcher = lambda _: None) -> BatchResults:
    """Make the runs below ``order.out``; ``watch`` receives the row of each ended run.

    With ``order.tasks``, seeds are tried until that many accepted tasks of a scene differ in name and goals: a
    first seed, then up to four rounds of as many seeds as tasks are missing. The same order resumes an
    interrupted batch; an order with more scenes or tasks extends it.

    Raises:
        InputError: the folder holds a batch with another configuration, or there is no cluster.
    """
    _write_or_compare_batch_file(order)
    names = _assign_unique_scene_names(order.scenes)
    rows: dict[str, BatchRow] = {}
    for _ in range(1 + _ROUNDS if order.tasks else 1):
        jobs = [job for scene in order.scenes for job in _list_remaining_scene_jobs(order, scene, names[scene], rows)]
        if jobs:
            _run_jobs_into_rows(order, jobs, rows, watch)
    results = summarize_rows(list(rows.values()))
    write_results(order.out, results)
    return results


def _run_jobs_into_rows(order: BatchOrder, jobs: Sequence[RunJob], rows: dict[str, BatchRow], watch: Watcher) -> None:
    ended: dict[str, BatchRow] = {}
    written = 0.0

    def store_row(end: RunEnd) -> None:
        nonlocal written
        row = make_batch_row(end)
        ended[row.run] = row
        if time.monotonic() > written + _WRITTEN_EVERY:
            write_results(order.out, summarize_rows([*rows.values(), *ended.values()]))
            written = time.monotonic()
        watch(row)

    config = load_config(order.config, order.settings).config
    try:
        run_jobs(
            jobs,
            store_row,
            workers=order.workers,
            timeout=order.timeout,
            engine=order.engine,
            address=order.address,
            variables=list_model_variables(map(config.model_for_role, ROLES)),
        )
    except KeyboardInterrupt:
        write_results(order.out, summarize_rows([*rows.values(), *ended.values()]))
        raise
    rows.update((job.name, ended[job.name]) for job in jobs)


def _list_remaining_scene_jobs(order: BatchOrder, scene: str, name: str, rows: dict[str, BatchRow]) -> Iterator[RunJob]:
    """The next runs of a scene: first a single run, whose scene the others reuse; then as many as tasks are missing."""
    ended = [row for row in rows.values() if row.scene == scene]
    tasks = sum(row.status == "accepted" and not row.repeats for row in mark_repeated_tasks(ended))
    options = [part for setting in order.settings for part in ("--set", setting)]
    if order.config is not None:
        options += ["--config", str(order.config.resolve())]
    first = order.out.resolve() / f"{name}-{order.seed}" if ended else None
    missing = (order.tasks or 1) - tasks if ended else 1
    for number in range(len(ended), len(ended) + missing):
        folder = f"{name}-{order.seed + number}"
        yield RunJob(folder, scene, order.seed + number, order.out.resolve() / folder, tuple(options), first)


def find_scenes_given_up(order: BatchOrder, results: BatchResults) -> Iterator[str]:
    """A line for each scene of an order with fewer different tasks than requested."""
    for scene, name in _assign_unique_scene_names(order.scenes).items() if order.tasks else ():
        ended = [row for row in results.rows if row.scene == scene]
        tasks = sum(row.status == "accepted" and not row.repeats for row in ended)
        if tasks < (order.tasks or 0):
            yield f"{name}: {tasks} of {order.tasks} different tasks, given up after {len(ended)} seeds"


def summarize_rows(rows: Sequence[BatchRow]) -> BatchResults:
    """The rows, with repeated tasks marked, and their summary."""
    marked = mark_repeated_tasks(rows)
    summary: dict[str, Any] = {
        "runs": len(marked),
        "status": dict(Counter(row.status for row in marked)),
        **describe_diversity(marked),
        "fixes": sum(row.code_fixes + row.test_fixes + row.task_fixes for row in marked),
        "cost": round(sum(row.cost for row in marked), 4),
        "seconds": round(sum(row.seconds for row in marked), 1),
    }
    return BatchResults(summary=summary, rows=tuple(marked))


def _assign_unique_scene_names(scenes: Sequence[str]) -> dict[str, str]:
    """Short scene names; duplicates are numbered."""
    seen: Counter[str] = Counter()
    names: dict[str, str] = {}
    for scene in scenes:
        short = short_scene_name(Path(scene))
        seen[short] += 1
        names[scene] = short if seen[short] == 1 else f"{short}.{seen[short]}"
    return names


def _write_or_compare_batch_file(order: BatchOrder) -> None:
    """Write the configuration of all runs to ``batch.json``, or refuse another configuration."""
    file = order.out / _ORDER
    ours: dict[str, Any] = {
        "config": load_config(order.config, order.settings).config.model_dump(mode="json"),
        "seed": order.seed,
        "content": [str(root) for root in content.content_search_roots()[:-1]],
        "grs-agents": __version__,
    }
    earlier = read_json(file, "name another folder with --out") if path_exists(file) else ours
    if earlier != ours:
        changed = [key for key in ours if earlier.get(key) != ours[key]]
        raise InputError(f"{order.out} holds a batch with another {', '.join(changed)}", "name another --out")
    write_json(file, ours, durable=True)


def mark_repeated_tasks(rows: Sequence[BatchRow]) -> list[BatchRow]:
    """The rows with ``repeats`` set to an earlier accepted run of the same scene with equal goals or name, if any."""
    first: dict[tuple[str, object], str] = {}
    marked: list[BatchRow] = []
    for row in rows:
        keys = [(row.scene, row.goals), (row.scene, row.task)]
        earlier = next((first[key] for key in keys if key in first), "") if row.status == "accepted" else ""
        marked.append(row.model_copy(update={"repeats": earlier}))
        if row.status == "accepted" and not earlier:
            first.update(dict.fromkeys(keys, row.run))
    return marked


def describe_diversity(rows: Sequence[BatchRow]) -> dict[str, Any]:
    """Number of accepted and of different tasks, families, and the mean distance of two of the first 1,000 tasks.

    The distance is the Jaccard distance of their sets of goals. GenSim (arXiv:2310.01361) compares embeddings of task
    descriptions instead.
    """
    accepted = [row for row in rows if row.status == "accepted"]
    tasks = [row for row in accepted if not row.repeats]
    distances = [
        1 - len(set(a.goals) & set(b.goals)) / max(1, len(set(a.goals) | set(b.goals)))
        for a, b in combinations(tasks[:_MOST_COMPARED], 2)
    ]
    return {
        "accepted": len(accepted),
        "different_tasks": len(tasks),
        "families": dict(sorted(Counter(row.family for row in tasks).items())),
        "mean_distance": round(sum(distances) / len(distances), 3) if distances else None,
    }
