"""Table of the ablation: rewards with bootstrap intervals, costs, and tests for differences between graphs."""

from collections.abc import Sequence
from itertools import combinations
from typing import Any, Final

import numpy as np

from evals.benchmark.ablation_runs import Measured
from evals.benchmark.rank_tests import kruskal_wallis, mann_whitney
from grs_agents.base.files import write_text
from grs_agents.runs.experiment_run import Experiment
from grs_agents.runs.experiments import markdown_table, terminal_table

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
    graphs = list(dict.fromkeys(one.graph for one in measured))
    by_graph = {graph: [one for one in measured if one.graph == graph] for graph in graphs}
    table = [_row(graph, runs) for graph, runs in by_graph.items()]
    tests = _tests({graph: [one.published or 0.0 for one in runs] for graph, runs in by_graph.items()})
    tables = (markdown_table(COLUMNS, table), markdown_table(list(tests[0]), tests))
    write_text(experiment.options.out / "table2.md", "\n".join(tables))
    experiment.tell(
        table,
        terminal_table("rewards of the trusted oracle (95 %)", _SHOWN, table),
        *(" ".join(f"{key} {value}" for key, value in test.items()) for test in tests),
        tests=tests,
        runs=[one.model_dump(mode="json") for one in measured],
    )


def _row(graph: str, runs: Sequence[Measured]) -> dict[str, Any]:
    published = [one.published for one in runs if one.published is not None]
    strict = [one.strict for one in runs if one.strict is not None]
    return {
        "graph": graph,
        "runs": len(runs),
        "reward": _with_interval(published),
        "errors as 0": _with_interval([one.published or 0.0 for one in runs]),
        "strict": _with_interval(strict),
        "paper": PAPER.get(graph, ""),
        "accepted": f"{sum(one.status == 'accepted' for one in runs) / len(runs):.0%}",
        "runtime errors": sum(one.published is None for one in runs),
        **{name.replace("_", " "): _mean(runs, name) for name in ("code_fixes", "test_fixes", "task_fixes", "hangs")},
        "tokens": round(sum(one.tokens for one in runs) / len(runs)),
        "cost": _mean(runs, "cost"),
        "seconds": _mean(runs, "seconds"),
    }


def _mean(runs: Sequence[Measured], field: str) -> float:
    return round(sum(float(getattr(one, field)) for one in runs) / len(runs), 2)


def _with_interval(values: Sequence[float]) -> str:
    """The mean and its 95 % interval by the bootstrap's percentiles; the same values give the same interval."""
    if not values:
        return "-"
    sample = np.asarray(values, np.float64)
    drawn = np.random.default_rng(0).choice(sample, (_SAMPLES, len(sample))).mean(axis=1)
    low, high = np.percentile(drawn, (2.5, 97.5))
    return f"{sample.mean():.3f} ({low:.3f}, {high:.3f})"


def _tests(rewards: dict[str, list[float]]) -> list[dict[str, Any]]:
    """Kruskal-Wallis over all graphs, and Mann-Whitney for each pair with Holm's correction; runtime errors count 0."""
    whole = kruskal_wallis(rewards, "graph")
    pairs = sorted(
        (mann_whitney(rewards[one], rewards[other]), f"{one} - {other}") for one, other in combinations(rewards, 2)
    )
    rows = [{"test": "Kruskal-Wallis", "of": "graph", "p": "1" if whole is None else f"{whole.p:.3g}"}]
    largest = 0.0
    for number, (p, names) in enumerate(pairs):
        largest = max(largest, min(1.0, p * (len(pairs) - number)))
        rows.append({"test": "Mann-Whitney, Holm", "of": names, "p": f"{largest:.3g}"})
    return rows
