"""The ablation: runs, a trusted rollout of each final program, and the table of rewards with tests."""

import json
import subprocess
import sys
from collections.abc import Callable, Sequence
from contextlib import suppress
from functools import partial
from itertools import combinations
from pathlib import Path
from typing import Any, Final

import numpy as np

from evals.benchmark.perception_runs import unique_names
from evals.benchmark.rank_tests import kruskal_wallis, mann_whitney
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
from grs_agents.runs.batch.run_process import RunJob
from grs_agents.runs.experiment_run import Experiment
from grs_agents.runs.experiments import markdown_table, terminal_table

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
    scenes: list[Path] = []
    for number, recipe in enumerate(wanted):
        scene = folder / f"made-{number}"
        if not (scene / "truth.json").is_file():
            synthesise(recipe, Library()).write(scene)
        scenes.append(scene)
    return scenes


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
    row, folder, hangs = make_batch_row(end), end.job.folder, 0
    with suppress(GrsError):  # the run did not begin
        events = read_events(folder / "events.jsonl")
        hangs = sum(event.kind == "tests_run" and event.report.get("outcome") == "timeout" for event in events)
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
        hangs=hangs,
        tokens=row.input_tokens + row.output_tokens,
        cost=row.cost,
        seconds=row.seconds,
    )


def _read_rollouts(folder: Path) -> list[dict[str, Any]]:
    """Rollouts of the run's audit; without an audit (failed tests), of `grs check` on its program."""
    audit = folder / "audit.json"
    if not audit.is_file():
        audit = folder.with_name(f"{folder.name}.check.json")
        if not audit.is_file() and (folder / "simulation.py").is_file():
            command = [sys.executable, "-m", "grs_agents", "check", str(folder), "--json"]
            done = subprocess.run(command, capture_output=True, text=True, check=False)
            if done.returncode in (0, 1):
                write_text(audit, json.dumps(json.loads(done.stdout)))
            else:
                print_escaped(f"{folder.name}: {done.stderr.strip()[-300:]}", error=True)
    if not audit.is_file():
        return []
    stored = read_json(audit, _REMEDY)
    return list(stored.get("audit", stored).get("rollouts", []))


PAPER: Final = {"llm_only": 0.47, "no_fix": 0.49, "no_router": 0.65, "grs": 0.71}
"""Table 2 of the paper: rewards without runs that ended in a runtime error, with Claude and GPT-4o."""
_SAMPLES: Final = 10_000
COLUMNS: Final = (
    "graph", "runs", "reward", "errors as 0", "strict", "paper", "accepted", "runtime errors",
    "code fixes", "test fixes", "task fixes", "hangs", "tokens", "cost", "seconds",
)  # fmt: skip
_SHOWN: Final = ("graph", "runs", "errors as 0", "strict", "accepted", "runtime errors")
"""The columns that a terminal is wide enough for; the files have all."""


def tell_figures(measured: Sequence[Measured], experiment: Experiment) -> None:
    """Write ``table2.md`` beside the results, and show the table with its tests."""
    graphs = list(dict.fromkeys(run.graph for run in measured))
    by_graph = {graph: [run for run in measured if run.graph == graph] for graph in graphs}
    table = [_row(graph, runs) for graph, runs in by_graph.items()]
    rewards = {graph: [run.published or 0.0 for run in runs] for graph, runs in by_graph.items()}
    whole = kruskal_wallis(rewards, "graph")
    pairs = sorted(
        (mann_whitney(rewards[first], rewards[second]), f"{first} - {second}")
        for first, second in combinations(rewards, 2)
    )
    tests = [{"test": "Kruskal-Wallis", "of": "graph", "p": "1" if whole is None else f"{whole.p:.3g}"}]
    largest = 0.0
    for number, (p, names) in enumerate(pairs):
        largest = max(largest, min(1.0, p * (len(pairs) - number)))
        tests.append({"test": "Mann-Whitney, Holm", "of": names, "p": f"{largest:.3g}"})
    tables = (markdown_table(COLUMNS, table), markdown_table(list(tests[0]), tests))
    write_text(experiment.options.out / "table2.md", "\n".join(tables))
    experiment.tell(
        table,
        terminal_table("rewards of the trusted oracle (95 %)", _SHOWN, table),
        *(" ".join(f"{key} {value}" for key, value in test.items()) for test in tests),
        tests=tests,
        runs=[run.model_dump(mode="json") for run in measured],
    )


def _row(graph: str, runs: Sequence[Measured]) -> dict[str, Any]:
    published = [run.published for run in runs if run.published is not None]
    strict = [run.strict for run in runs if run.strict is not None]
    return {
        "graph": graph,
        "runs": len(runs),
        "reward": _with_interval(published),
        "errors as 0": _with_interval([run.published or 0.0 for run in runs]),
        "strict": _with_interval(strict),
        "paper": PAPER.get(graph, ""),
        "accepted": f"{sum(run.status == 'accepted' for run in runs) / len(runs):.0%}",
        "runtime errors": sum(run.published is None for run in runs),
        **{name.replace("_", " "): _mean(runs, name) for name in ("code_fixes", "test_fixes", "task_fixes", "hangs")},
        "tokens": round(sum(run.tokens for run in runs) / len(runs)),
        "cost": _mean(runs, "cost"),
        "seconds": _mean(runs, "seconds"),
    }


def _mean(runs: Sequence[Measured], field: str) -> float:
    return round(sum(float(getattr(run, field)) for run in runs) / len(runs), 2)


def _with_interval(values: Sequence[float]) -> str:
    """The mean and its 95 % interval by the bootstrap's percentiles; the same values give the same interval."""
    if not values:
        return "-"
    sample = np.asarray(values, np.float64)
    drawn = np.random.default_rng(0).choice(sample, (_SAMPLES, len(sample))).mean(axis=1)
    low, high = np.percentile(drawn, (2.5, 97.5))
    return f"{sample.mean():.3f} ({low:.3f}, {high:.3f})"
