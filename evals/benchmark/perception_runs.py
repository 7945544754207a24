"""Measure perception on many scenes: find or make them, measure each in a process of its own, write the figures."""

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from pydantic import ValidationError

from evals.benchmark.contact_sheet import measured_row, write_pages, write_plots
from evals.benchmark.figures import perception_targets, write_figures
from evals.benchmark.ground_truth import bop_sources, labelled_folders
from evals.benchmark.segmentation_metrics import sum_scores
from evals.benchmark.types import Order, Result, SceneFigures, result_file
from evals.benchmark.worker_processes import EVALS, error_of, run_jobs, run_worker
from evals.synthesis.scene import Recipe
from grs_agents.base import content
from grs_agents.base.errors import InputError
from grs_agents.perception.reading.bop import is_bop_source
from grs_agents.perception.reading.scene_source import short_scene_name
from grs_agents.runs.experiment_run import Experiment
from grs_agents.runs.experiments import terminal_table
from grs_agents.runs.metrics import figures_table, metrics_table

_SHOWN = ("scene", "objects", "segments", "F1@.5", "IoU", "centre mm", "CPU s")
"""Columns that fit a terminal; the files have all."""


@dataclass(frozen=True)
class MeasurementOptions:
    """Options of the measurement of each scene: the segment tool, the seed of the table search, the number of
    timings, the folder of the tool's model, the disabled rules of segmentation, and settings of the run."""

    tool: str
    seed: int = 0
    repeats: int = 1
    model: str | None = None
    without: tuple[str, ...] = ()
    settings: tuple[str, ...] = ()


def orders_of(sources: Sequence[str], work: MeasurementOptions, most: int) -> list[Order]:
    """Orders for existing labelled scenes.

    Args:
        sources: scene folders, folders of scene folders, or ``bop:ROOT/SPLIT``, with a scene, with an image.
        work: the options of their measurement.
        most: largest number of images of a data set, spread evenly.

    Raises:
        InputError: a folder holds no labelled scene.
    """
    paths: list[str] = []
    for source in sources:
        bop = is_bop_source(Path(source))
        paths += bop_sources(source, most) if bop else [str(folder) for folder in labelled_folders(Path(source))]
    names = unique_names([Path(source) for source in paths])
    return [_order(name, source, None, work) for name, source in zip(names, paths, strict=True)]


def unique_names(sources: Sequence[Path]) -> list[str]:
    """Short names of scenes, each with its place in the list where two are alike."""
    names = [short_scene_name(source) for source in sources]
    return [name if names.count(name) == 1 else f"{index:03d}-{name}" for index, name in enumerate(names)]


def synthesised_orders(wanted: Sequence[Recipe], out: Path, work: MeasurementOptions) -> list[Order]:
    """Orders for scenes that are made below ``out/synthesised`` if they are not there yet."""
    code = content.hash_files(
        EVALS / "synthesis", content.package_root() / "library", content.content_path("assets", "library")
    )[:12]
    return [
        _order(
            f"synth_{recipe.seed:04d}",
            str(
                out
                / "synthesised"
                / code
                / f"{recipe.seed:04d}-{hashlib.sha256(recipe.model_dump_json().encode()).hexdigest()[:8]}"
            ),
            recipe,
            work,
        )
        for recipe in wanted
    ]


def run_orders(orders: Sequence[Order], experiment: Experiment) -> int:
    """Measure every scene, write figures and pictures to the experiment's folder, and print them.

    Stored results of the same scene, tool and code are reused, so an interrupted experiment resumes.

    Returns:
        0 if every scene could be measured, 1 if not.
    """
    out, workers = experiment.options.out, experiment.options.workers
    ordered = run_jobs("scenes", orders, lambda order: _measured(order, out), workers, lambda order: order.name)
    scenes = [result.figures for result in ordered]
    value = write_figures(out, scenes)
    write_plots(out, scenes)
    drawn = [result for result in ordered if result_file(out, result.order.name).with_suffix(".png").exists()]
    pages = write_pages(out, [measured_row(out, result) for result in drawn])
    experiment.tell(
        figures_table(targets := perception_targets(scenes)),
        terminal_table("perception", _SHOWN, [*value["rows"], *value["totals"]]),
        metrics_table("targets", targets),
        f"figures.md, scenes.csv, objects.csv, scores.png, errors.png, {', '.join(pages)} are in {out}",
        **value,
    )
    return 0 if all(not scene.error for scene in scenes) else 1


def _order(name: str, source: str, recipe: Recipe | None, work: MeasurementOptions) -> Order:
    overlays = tuple(str(root) for root in content.content_search_roots()[:-1])
    rooms = [content.package_root() / room for room in ("agents", "graph", "perception")]
    code = content.hash_files(*rooms, EVALS / "benchmark", content.content_path("tools", "segment_rgbd").parent)
    return Order(
        name=name,
        source=source,
        recipe=recipe,
        tool=work.tool,
        model=work.model,
        without=work.without,
        seed=work.seed,
        settings=work.settings,
        repeats=work.repeats,
        content=overlays,
        fingerprint=code + _age(source),
    )


def _age(source: str) -> str:
    """Digest of the modification times of the scene's files; empty for a synthesised scene, named by its recipe."""
    folder = Path(source)
    if "synthesised" in folder.parts or not folder.is_dir():
        return ""
    times = sorted((file.name, file.stat().st_mtime_ns) for file in folder.iterdir())
    return "-" + hashlib.sha256(str(times).encode()).hexdigest()[:12]


def _measured(order: Order, out: Path) -> Result:
    earlier = _earlier(order, out)
    if earlier is not None:
        return earlier
    for verb in ("make", "measure") if order.recipe is not None else ("measure",):
        if error := error_of(run_worker("perception_worker", (verb, str(out)), order.model_dump_json())):
            return Result(order=order, figures=SceneFigures(name=order.name, score=sum_scores([]), error=error))
    result = _earlier(order, out)
    if result is None:
        raise InputError(f"{result_file(out, order.name)} changed while it was read", "name another --out")
    return result


def _earlier(order: Order, out: Path) -> Result | None:
    """The stored result of the same order, if any."""
    try:
        result = Result.model_validate_json(result_file(out, order.name).read_text(encoding="utf-8"))
    except (OSError, ValidationError):
        return None
    return result if result.order == order and result_file(out, order.name).with_suffix(".png").exists() else None
