"""What the index of assets costs at the size of Objaverse, and how many of the nearest it finds: synthetic data."""

import json
import tempfile
from collections.abc import Sequence
from pathlib import Path

from rich.console import Console
from rich.table import Table

from evals.benchmark.retrieval import measure_retrieval, retrieval_targets
from grs_agents.metrics import metrics_to_dicts
from grs_agents.runs import positive_int
from grs_agents.terminal import EscapingParser


def main(arguments: Sequence[str]) -> int:
    """Build an index of synthetic assets, search it and add to it.

    Returns:
        0 if every target is reached, 1 if not.

    Raises:
        GrsError: faiss is not installed.
    """
    parser = EscapingParser(prog="grs eval retrieval_scale", description=__doc__)
    parser.add_argument("--assets", type=positive_int, default=150_000, help="how many")
    parser.add_argument("--queries", type=positive_int, default=200, help="how many searches")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--json", action="store_true", help="print the figures as JSON")
    options = parser.parse_args(arguments)
    with tempfile.TemporaryDirectory(prefix="grs-index-") as folder:
        figures = measure_retrieval(Path(folder) / "index", options.assets, options.queries, options.seed)
    bounds = retrieval_targets(figures)
    if options.json:
        sizes = {"assets": options.assets, "data": "synthetic", "figures": figures}
        print(json.dumps({**sizes, "targets": metrics_to_dicts(bounds)}, indent=2))
    else:
        limits = {bound.name: bound.format_target_value() for bound in bounds}
        shown = Table("figure", "measured", "target", title=f"{options.assets} synthetic assets")
        for name, value in figures.items():
            shown.add_row(name, f"{value:.4g}", limits.get(name, ""))
        Console().print(shown)
    return 0 if all(one.is_target_met for one in bounds) else 1
