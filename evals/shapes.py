"""How good reconstructed shapes are: of known assets, photographed alone with a sensor's noise, and of real scenes."""

from collections.abc import Sequence
from functools import partial
from pathlib import Path

from evals.benchmark.shape_runs import (
    ShapeFigures,
    Shapes,
    measure_known,
    measure_real,
    scene_folders,
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
    found = {
        name: _gather_figures(some, options.out, name)
        for name, some in (("known", rows[: options.known]), ("real", rows[options.known :]))
    }
    targets = shape_targets(found["known"], found["real"])
    table = [
        {"figure": row["figure"], "measured": _text(row["value"]), "target": _text(row["target"])} for row in targets
    ]
    missed = [row["figure"] for row in targets if row["met"] is False]
    experiment.tell(
        table,
        terminal_table("shapes", ("figure", "measured", "target"), table),
        f"missed: {', '.join(missed) or 'none'}",
        targets=targets,
        **{name: [one.model_dump() for one in some] for name, some in found.items()},
    )
    return 1 if missed else 0


def _gather_figures(rows: Sequence[Shapes], out: Path, name: str) -> list[ShapeFigures]:
    """All figures of the rows, whose pictures become the sheets of this name."""
    write_sheets(out, name, [out / "pictures" / file for row in rows for file in row.pictures])
    return [one for row in rows for one in row.figures]


def _text(value: float | None) -> str:
    return "" if value is None else f"{value:g}"
