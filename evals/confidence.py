"""Calibration of match confidence: the share of right matches, with objects that the library lacks."""

from collections.abc import Sequence
from functools import partial
from pathlib import Path

from rich.table import Table

from evals.benchmark.calibration import (
    NamedAsset,
    calibration_figures,
    fit_coefficients,
    name_assets,
    reliability,
    write_reliability_diagram,
)
from evals.benchmark.ground_truth import scene_folders
from grs_agents.base import Frozen
from grs_agents.base.errors import InputError
from grs_agents.library.library import Library
from grs_agents.perception.configuration import DEFAULT
from grs_agents.perception.matching.confidence import INPUTS
from grs_agents.runs.experiment_run import ExperimentParser
from grs_agents.runs.metrics import figures_table, metrics_table, metrics_to_dicts
from grs_agents.sandbox.host.sandbox import Sandbox
from grs_agents.toolkit import ToolContext


class _Named(Frozen):
    assets: tuple[NamedAsset, ...]  # of a scene


def main(arguments: Sequence[str]) -> int:
    """Segment and match labelled scenes, and compare the confidence of each match with its correctness.

    Returns:
        0 if every target is reached, 1 if not.

    Raises:
        InputError: a folder holds no scene, or a scene without known assets.
    """
    parser = ExperimentParser("confidence", __doc__)
    parser.add_argument(
        "--scenes",
        action="append",
        required=True,
        metavar="DIR",
        help="folder of scenes with truth.json, as `grs eval perception --synthesised` makes them; repeat",
    )
    parser.add_argument("--segment", metavar="TOOL", help="what segments; as configured")
    parser.add_argument("--fit", action="store_true", help="also print the coefficients that fit these scenes best")
    experiment = parser.start(arguments)
    options, config = experiment.options, experiment.config
    folders = scene_folders(map(Path, options.scenes))
    with Sandbox() as sandbox:
        context = ToolContext(sandbox=sandbox, library=Library(), limits=config.limits)

        def name(folder: Path) -> _Named:
            return _Named(assets=tuple(name_assets(folder, options.segment or config.tools.segment, context)))

        work = {str(folder): partial(name, folder) for folder in folders}
        rows = experiment.make_or_reuse_rows(_Named, work, choosing=("scenes", "fit"))
    named = [asset for row in rows for asset in row.assets]
    if not named:
        raise InputError("no segment of these scenes is like an asset", "name scenes with objects")
    figures = calibration_figures(named, DEFAULT.matching.least)
    write_reliability_diagram(options.out / "reliability.png", named)
    fitted = dict(zip(("constant", *INPUTS), fit_coefficients(named), strict=True)) if options.fit else {}
    bins = reliability(named)
    shown = Table("confidence", "right", "matches", title="reliability")
    for row in bins:
        shown.add_row(f"{row['confidence']:.2f}", f"{row['right']:.2f}", str(row["matches"]))
    experiment.tell(
        figures_table(figures),
        metrics_table("confidence of matches", figures),
        shown,
        *(f"{name}: {value:.4g}" for name, value in fitted.items()),
        f"reliability.png is in {options.out}",
        figures=metrics_to_dicts(figures),
        reliability=bins,
        fitted=fitted,
    )
    return 0 if all(figure.is_target_met is not False for figure in figures) else 1
