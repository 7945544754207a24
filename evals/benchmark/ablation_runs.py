"""The runs of the ablation, and a trusted rollout of every program that they end with."""

import json
import subprocess
import sys
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any

from evals.benchmark.perception_runs import unique_names
from evals.synthesis import Recipe, synthesise
from grs_agents.base import Frozen
from grs_agents.base.errors import GrsError
from grs_agents.base.files import write_text
from grs_agents.base.foreign.files import read_json
from grs_agents.base.terminal import print_escaped
from grs_agents.base.trace.log import read_events
from grs_agents.library.library import Library
from grs_agents.perception.reading.scene_source import short_scene_name
from grs_agents.runs.batch.jobs import run_jobs
from grs_agents.runs.batch.row import make_batch_row
from grs_agents.runs.batch.run_process import RunEnd, RunJob
from grs_agents.runs.experiment_run import Experiment

_REMEDY = "name another --out"


class Measured(Frozen):
    """A run of a graph, with the trusted oracle's rewards for its final program."""

    graph: str
    scene: str
    seed: int
    status: str
    task: str
    published: float | None  # mean over the audit's seeds; `None` where no seed gave a task instance
    strict: float | None
    code_fixes: int
    test_fixes: int
    task_fixes: int
    hangs: int  # runs of tests that had to be stopped
    tokens: int
    cost: float
    seconds: float

    @property
    def error(self) -> str:
        """Reason of a missing verdict; empty if there is a verdict. Such a run is repeated."""
        return "" if self.status in ("accepted", "rejected") else self.status

    def __str__(self) -> str:
        reward = "no reward" if self.published is None else f"reward {self.published:.2f}, strict {self.strict:.2f}"
        return f"{self.graph} {self.scene} {self.seed}: {self.status}, {reward}"


def make_scenes(wanted: Sequence[Recipe], folder: Path) -> list[Path]:
    """Synthesise the scenes that are not there yet."""
    made: list[Path] = []
    for number, recipe in enumerate(wanted):
        scene = folder / f"made-{number}"
        if not (scene / "truth.json").is_file():
            synthesise(recipe, Library()).write(scene)
        made.append(scene)
    return made


def make_runs(scenes: Sequence[str], graphs: Sequence[str], experiment: Experiment) -> list[Measured]:
    """Make the missing runs. Scene and seed determine the offline author's task, so all graphs meet the same tasks.

    The first run of each scene comprehends it, and the others reuse its scene: runs differ by authors and fixers
    only.
    """
    options = experiment.options
    common = [part for setting in options.settings for part in ("--set", setting)]
    if options.config is not None:
        common += ["--config", str(options.config.resolve())]
    work: dict[str, Callable[[], Measured]] = {}
    firsts: dict[str, Path] = {}
    for seed in range(options.runs):
        for scene, short in zip(scenes, unique_names([Path(scene) for scene in scenes]), strict=True):
            for graph in graphs:
                name = f"{graph}-{short}-{seed}"
                arguments = (*common, "--set", f"graph={graph}")
                folder = options.out.resolve() / name
                job = RunJob(name, scene, seed, folder, arguments, firsts.get(short))
                firsts.setdefault(short, folder)
                work[name] = partial(_run, graph, job, options.timeout)
    choosing = ("scenes", "synthesised", "runs", "graphs", "timeout")
    make = partial(experiment.make_or_reuse_rows, Measured, workers=options.workers, choosing=choosing, show=str)
    make({folder.name: work[folder.name] for folder in firsts.values()})
    return make(work)


def _run(graph: str, job: RunJob, timeout: float) -> Measured:
    (end,) = run_jobs([job], timeout=timeout)
    return _measure(graph, end)


def _measure(graph: str, end: RunEnd) -> Measured:
    row, folder = make_batch_row(end), end.job.folder
    rollouts = [rollout["episode"] for rollout in _read_rollouts(folder)]
    published, strict = ([float(episode[kind]) for episode in rollouts] for kind in ("reward", "strict"))
    return Measured(
        graph=graph,
        scene=short_scene_name(Path(row.scene)),
        seed=row.seed,
        status=row.status,
        task=row.task,
        published=sum(published) / len(published) if published else None,
        strict=sum(strict) / len(strict) if strict else None,
        code_fixes=row.code_fixes,
        test_fixes=row.test_fixes,
        task_fixes=row.task_fixes,
        hangs=_count_hangs(folder),
        tokens=row.input_tokens + row.output_tokens,
        cost=row.cost,
        seconds=row.seconds,
    )


def _count_hangs(folder: Path) -> int:
    try:
        events = read_events(folder / "events.jsonl")
    except GrsError:  # the run did not begin
        return 0
    return sum(event.kind == "tests_run" and event.report.get("outcome") == "timeout" for event in events)


def _read_rollouts(folder: Path) -> list[dict[str, Any]]:
    """Rollouts of the run's audit; without an audit, because its tests failed, those of a check of its program."""
    audit = folder / "audit.json"
    if not audit.is_file():
        audit = folder.with_name(f"{folder.name}.check.json")
        if not audit.is_file() and (folder / "simulation.py").is_file():
            _check(folder, audit)
    if not audit.is_file():
        return []
    found = read_json(audit, _REMEDY)
    return list(found.get("audit", found).get("rollouts", []))


def _check(folder: Path, out: Path) -> None:
    """Write the result of ``grs check`` on the final program of a run."""
    command = [sys.executable, "-m", "grs_agents", "check", str(folder), "--json"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode not in (0, 1):
        print_escaped(f"{folder.name}: {done.stderr.strip()[-300:]}", error=True)
        return
    write_text(out, json.dumps(json.loads(done.stdout)))
