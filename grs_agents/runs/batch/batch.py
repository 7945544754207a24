"""Runs of many scenes in one folder, which can be interrupted, gone on with and extended."""

import time
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from grs_agents.base import content
from grs_agents.base.config.load import load_config
from grs_agents.base.config.schema import ROLES
from grs_agents.base.errors import InputError
from grs_agents.base.files import write_json, write_text
from grs_agents.base.foreign.files import path_exists, read_json
from grs_agents.base.version import __version__
from grs_agents.models.factory import list_model_variables
from grs_agents.perception.reading.scene_source import short_scene_name
from grs_agents.runs.batch.diversity import describe_diversity, mark_repeated_tasks
from grs_agents.runs.batch.jobs import Engine, run_jobs
from grs_agents.runs.batch.page import render_page
from grs_agents.runs.batch.results import BatchResults, write_results
from grs_agents.runs.batch.row import BatchRow, make_batch_row
from grs_agents.runs.batch.run_process import RunEnd, RunJob

_ORDER: Final = "batch.json"
_ROUNDS: Final = 4
"""So often as many seeds are tried as tasks are wanting: the offline author repeats itself in about one of three, and a
scene with few objects holds few tasks."""
_WRITTEN_EVERY: Final = 2.0
"""Seconds: the files grow with the batch, and what a killed batch did not write is read from its runs again."""
Watcher = Callable[[BatchRow], None]


@dataclass(frozen=True)
class BatchOrder:
    """What is to be run."""

    scenes: tuple[str, ...]  # as `grs run` takes them
    out: Path
    tasks: int | None = None  # different tasks of each scene that are wanted; `None`: one run of each
    seed: int = 0  # of the first run of each scene
    config: Path | None = None
    settings: tuple[str, ...] = ()
    workers: int = 2
    timeout: float = 600  # seconds before a run is killed
    engine: Engine = "local"
    address: str | None = None  # of a Ray cluster


def run_batch(order: BatchOrder, watch: Watcher = lambda _: None) -> BatchResults:
    """Make the runs below ``order.out``; ``watch`` hears of each as it ends.

    Where ``order.tasks`` is given, seeds are tried until so many accepted tasks of a scene differ in name and goals:
    one seed, then up to four times as many as tasks are wanting. The same order goes on where it was interrupted; one
    with more scenes or tasks adds runs.

    Raises:
        InputError: the folder holds a batch with another configuration, or no cluster answers.
    """
    _write_or_compare_batch_file(order)
    names = _assign_unique_scene_names(order.scenes)
    rows: dict[str, BatchRow] = {}
    for _ in range(1 + _ROUNDS if order.tasks else 1):
        jobs = [job for scene in order.scenes for job in _list_remaining_scene_jobs(order, scene, names[scene], rows)]
        if jobs:
            _run_jobs_into_rows(order, jobs, rows, watch)
    results = summarize_rows(list(rows.values()))
    _write_results_and_page(order.out, results)
    return results


def _run_jobs_into_rows(order: BatchOrder, jobs: Sequence[RunJob], rows: dict[str, BatchRow], watch: Watcher) -> None:
    ended: dict[str, BatchRow] = {}
    written = 0.0

    def store_row(end: RunEnd) -> None:
        nonlocal written
        row = make_batch_row(end)
        ended[row.run] = row
        if time.monotonic() > written + _WRITTEN_EVERY:
            _write_results_and_page(order.out, summarize_rows([*rows.values(), *ended.values()]))
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
        _write_results_and_page(order.out, summarize_rows([*rows.values(), *ended.values()]))
        raise
    rows.update((job.name, ended[job.name]) for job in jobs)


def _list_remaining_scene_jobs(order: BatchOrder, scene: str, name: str, rows: dict[str, BatchRow]) -> Iterator[RunJob]:
    """The runs of one scene in one round: the first alone, since the others take its scene over; then as many as tasks
    are still wanting."""
    made = [row for row in rows.values() if row.scene == scene]
    found = sum(row.status == "accepted" and not row.repeats for row in mark_repeated_tasks(made))
    options = [part for setting in order.settings for part in ("--set", setting)]
    if order.config is not None:
        options += ["--config", str(order.config.resolve())]
    first = order.out.resolve() / f"{name}-{order.seed}" if made else None
    wanting = (order.tasks or 1) - found if made else 1
    for number in range(len(made), len(made) + wanting):
        folder = f"{name}-{order.seed + number}"
        yield RunJob(folder, scene, order.seed + number, order.out.resolve() / folder, tuple(options), first)


def find_scenes_given_up(order: BatchOrder, results: BatchResults) -> Iterator[str]:
    """A line for each scene of an order that came to fewer different tasks than were wanted."""
    for scene, name in _assign_unique_scene_names(order.scenes).items() if order.tasks else ():
        made = [row for row in results.rows if row.scene == scene]
        found = sum(row.status == "accepted" and not row.repeats for row in made)
        if found < (order.tasks or 0):
            yield f"{name}: {found} of {order.tasks} different tasks, given up after {len(made)} seeds"


def summarize_rows(rows: Sequence[BatchRow]) -> BatchResults:
    """The rows, repeats marked, with what they come to."""
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


def _write_results_and_page(out: Path, results: BatchResults) -> None:
    write_results(out, results)
    write_text(out / "index.html", render_page(out, results))


def _assign_unique_scene_names(scenes: Sequence[str]) -> dict[str, str]:
    """A short name for each scene, numbered where two share one."""
    seen: Counter[str] = Counter()
    names: dict[str, str] = {}
    for scene in scenes:
        short = short_scene_name(Path(scene))
        seen[short] += 1
        names[scene] = short if seen[short] == 1 else f"{short}.{seen[short]}"
    return names


def _write_or_compare_batch_file(order: BatchOrder) -> None:
    """Write into ``batch.json`` what runs depend on, so that runs of two configurations are never mixed."""
    file = order.out / _ORDER
    ours: dict[str, Any] = {
        "config": load_config(order.config, order.settings).config.model_dump(mode="json"),
        "seed": order.seed,
        "content": [str(root) for root in content.content_search_roots()[:-1]],
        "grs-agents": __version__,
    }
    earlier = read_json(file, "name another folder with --out") if path_exists(file) else ours
    if earlier != ours:
        differ = [key for key in ours if earlier.get(key) != ours[key]]
        raise InputError(f"{order.out} holds a batch with another {', '.join(differ)}", "name another --out")
    write_json(file, ours, durable=True)
