"""Errors of reconstructed shapes: known assets, photographed alone with a sensor's noise, and real scenes."""

from collections.abc import Sequence
from functools import partial
from pathlib import Path

from evals.benchmark.ground_truth import scene_folders
from evals.benchmark.shape_runs import (
    ShapeFigures,
    Shapes,
    measure_known,
    measure_real,
    shape_targets,
    write_sheets,
)
from grs_agents.runs.experiment_run import ExperimentParser
from grs_agents.runs.experiments import positive_int, terminal_table


def main(arguments: Sequence[str]) -> int:
    """Reconstruct every object, and write figures and sheets to look at.

    Returns:
        0 if every target is met, 1 if not.

    Raises:
        InputError: a folder holds no scene.
    """
    parser = ExperimentParser("shapes", __doc__)
    parser.add_argument("--known", type=positive_int, default=60, metavar="N", help="assets to photograph: 60")
    parser.add_argument("--seed", type=int, default=0, help="of assets, cameras and noise")
    parser.add_argument(
        "--scenes", type=Path, action="append", default=[], metavar="DIR", help="scenes, or a folder of them; repeat"
    )
    experiment = parser.start(arguments)
    options, pictures = experiment.options, experiment.options.out / "pictures"
    folders = scene_folders(options.scenes)
    work = {
        "known": {
            f"known {number}": partial(measure_known, number, options.seed, pictures) for number in range(options.known)
        },
        "real": {str(folder): partial(measure_real, folder, pictures) for folder in folders},
    }
    rows = experiment.make_or_reuse_rows(Shapes, work["known"] | work["real"], choosing=("known", "scenes"))
    figures: dict[str, list[ShapeFigures]] = {}
    for name, group in (("known", rows[: options.known]), ("real", rows[options.known :])):
        write_sheets(options.out, name, [pictures / file for row in group for file in row.pictures])
        figures[name] = [item for row in group for item in row.figures]
    targets = shape_targets(figures["known"], figures["real"])
    table = [
        {"figure": row["figure"], "measured": _text(row["value"]), "target": _text(row["target"])} for row in targets
    ]
    missed = [row["figure"] for row in targets if row["met"] is False]
    experiment.tell(
        table,
        terminal_table("shapes", ("figure", "measured", "target"), table),
        f"missed: {', '.join(missed) or 'none'}",
        targets=targets,
        **{name: [item.model_dump() for item in some] for name, some in figures.items()},
    )
    return 1 if missed else 0


def _text(value: float | None) -> str:
    return "" if value is None else f"{value:g}"
