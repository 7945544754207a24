"""Cost and recall of the asset index at the size of Objaverse, on synthetic data."""

import tempfile
from collections.abc import Sequence
from pathlib import Path

from evals.benchmark.retrieval import measure_retrieval, retrieval_targets
from grs_agents.base import Frozen
from grs_agents.runs.experiment_run import ExperimentParser
from grs_agents.runs.experiments import positive_int, terminal_table
from grs_agents.runs.metrics import metrics_to_dicts


class _Index(Frozen):
    figures: dict[str, float]


def main(arguments: Sequence[str]) -> int:
    """Build an index of synthetic assets, search it and add to it.

    Returns:
        0 if every target is reached, 1 if not.

    Raises:
        GrsError: faiss is not installed.
    """
    parser = ExperimentParser("retrieval_scale", __doc__)
    parser.add_argument("--assets", type=positive_int, default=150_000, help="how many")
    parser.add_argument("--queries", type=positive_int, default=200, help="how many searches")
    parser.add_argument("--seed", type=int, default=0)
    experiment = parser.start(arguments)
    options = experiment.options

    def measure() -> _Index:
        with tempfile.TemporaryDirectory(prefix="grs-index-") as folder:
            return _Index(
                figures=measure_retrieval(Path(folder) / "index", options.assets, options.queries, options.seed)
            )

    (index,) = experiment.make_or_reuse_rows(_Index, {"index": measure})
    bounds = retrieval_targets(index.figures)
    limits = {bound.name: bound.format_target_value() for bound in bounds}
    rows = [
        {"figure": name, "measured": f"{value:.4g}", "target": limits.get(name, "")}
        for name, value in index.figures.items()
    ]
    shown = terminal_table(f"{options.assets} synthetic assets", ("figure", "measured", "target"), rows)
    sizes = {"assets": options.assets, "data": "synthetic", "figures": index.figures}
    experiment.tell(rows, shown, **sizes, targets=metrics_to_dicts(bounds))
    return 0 if all(bound.is_target_met for bound in bounds) else 1
