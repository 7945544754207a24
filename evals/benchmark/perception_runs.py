"""Measure perception on many scenes: find or make them, measure each in a process of its own, write the figures."""

import hashlib
import os
import subprocess
import sys
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from dataclasses import dataclass
from pathlib import Path

from pydantic import ValidationError
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn
from rich.table import Table

from evals.benchmark.contact_sheet import write_plots, write_sheet
from evals.benchmark.figures import Target, perception_targets, write_figures
from evals.benchmark.ground_truth import labelled_folders
from evals.benchmark.ground_truth_bop import bop_sources
from evals.benchmark.segmentation_metrics import SegmentationScore
from evals.benchmark.types import Order, Result, SceneFigures, result_file
from evals.synthesis.scene import Recipe
from grs_agents import content, terminal
from grs_agents.errors import InputError
from grs_agents.perception.reading import scene_name
from grs_agents.perception.reading.bop import is_bop
from grs_agents.run.experiments import table
from grs_agents.terminal import say_json

ONE_CORE = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "MKL_NUM_THREADS": "1"}
EVALS = Path(__file__).parent.parent
ROOT = EVALS.parent
_SHOWN = ("scene", "objects", "segments", "F1@.5", "IoU", "centre mm", "CPU s")
"""What of a row fits a terminal; the rest is in the files."""


@dataclass(frozen=True)
class MeasurementOptions:
    """What is done with each scene: the segment tool, the seed of the search for the table, how often it is timed,
    and the folder of the tool's model."""

    tool: str
    seed: int = 0
    repeats: int = 1
    model: str | None = None


def orders_of(sources: Sequence[str], work: MeasurementOptions, most: int) -> list[Order]:
    """Orders for labelled scenes that are there.

    Args:
        sources: scene folders, folders of scene folders, or ``bop:ROOT/SPLIT``, with a scene, with an image.
        work: what is done with them.
        most: how many images of a data set, spread evenly.

    Raises:
        InputError: a folder holds no labelled scene.
    """
    found: list[str] = []
    for source in sources:
        bop = is_bop(Path(source))
        found += bop_sources(source, most) if bop else [str(folder) for folder in labelled_folders(Path(source))]
    names = [scene_name(Path(source)) for source in found]
    names = [name if names.count(name) == 1 else f"{index:03d}-{name}" for index, name in enumerate(names)]
    return [_order(name, source, None, work) for name, source in zip(names, found, strict=True)]


def synthesised_orders(wanted: Sequence[Recipe], out: Path, work: MeasurementOptions) -> list[Order]:
    """Orders for scenes that are made below ``out/synthesised`` if they are not there yet."""
    made = fingerprint(EVALS / "synthesis", content.package_root() / "library", content.path("assets", "library"))[:12]
    return [
        _order(f"synth_{recipe.seed:04d}", str(out / "synthesised" / made / _stem(recipe)), recipe, work)
        for recipe in wanted
    ]


def run_orders(orders: Sequence[Order], out: Path, workers: int, as_json: bool) -> int:
    """Measure every scene, write figures and pictures to ``out``, and print them.

    What was measured with the same scene, tool and code is not measured again, so that an interrupted run goes on.

    Returns:
        0 if every scene could be measured, 1 if not.
    """
    results: dict[str, Result] = {}
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn())
    with Progress(*columns, console=terminal.console(error=True)) as progress, ThreadPoolExecutor(workers) as pool:
        bar = progress.add_task("scenes", total=len(orders))
        waiting = {pool.submit(_measured, order, out): order for order in orders}
        for future in as_completed(waiting):
            name = waiting[future].name
            results[name] = future.result()
            progress.update(bar, advance=1, description=name)
    ordered = [results[order.name] for order in orders]
    scenes = [result.figures for result in ordered]
    value = write_figures(out, scenes)
    write_plots(out, scenes)
    drawn = [result for result in ordered if result_file(out, result.order.name).with_suffix(".png").exists()]
    if drawn:
        write_sheet(out, drawn)
    if as_json:
        say_json(value)
    else:
        console = terminal.console()
        console.print(table("perception", _SHOWN, [*value["rows"], *value["totals"]]))
        console.print(_targets(perception_targets(scenes)))
        console.print(f"figures.md, scenes.csv, objects.csv, sheet.png, scores.png and errors.png are in {out}")
    return 0 if all(not scene.error for scene in scenes) else 1


def _order(name: str, source: str, recipe: Recipe | None, work: MeasurementOptions) -> Order:
    overlays = tuple(str(root) for root in content.roots()[:-1])
    tools = [content.path("tools", work.tool)] if work.tool else []
    code = fingerprint(content.package_root() / "perception", EVALS / "benchmark", *tools)
    return Order(
        name=name,
        source=source,
        recipe=recipe,
        tool=work.tool,
        model=work.model,
        seed=work.seed,
        repeats=work.repeats,
        content=overlays,
        fingerprint=code + _age(source),
    )


def worker_environment() -> dict[str, str]:
    """The environment of a worker: one core, and the checkout first among what it imports from."""
    paths = [str(ROOT), *filter(None, [os.environ.get("PYTHONPATH")])]
    return {**os.environ, **ONE_CORE, "PYTHONPATH": os.pathsep.join(paths)}


def fingerprint(*places: Path) -> str:
    """A hash of all files in these folders, so that figures are never older than the code they are of."""
    files = sorted(file for place in places for file in (place.rglob("*") if place.is_dir() else [place]))
    whole = hashlib.sha256()
    for file in files:
        if file.is_file() and "__pycache__" not in file.parts:
            whole.update(file.name.encode() + b"\0" + file.read_bytes())
    return whole.hexdigest()


def _age(source: str) -> str:
    """When the scene's files were written last; synthesised ones are told by their folder's name."""
    folder = Path(source)
    if "synthesised" in folder.parts or not folder.is_dir():
        return ""
    return "-" + hashlib.sha256(str(sorted((file.name, file.stat().st_mtime_ns) for file in folder.iterdir())).encode()
                                ).hexdigest()[:12]  # fmt: skip


def _stem(recipe: Recipe) -> str:
    """A folder name that tells recipes apart."""
    return f"{recipe.seed:04d}-{hashlib.sha256(recipe.model_dump_json().encode()).hexdigest()[:8]}"


def _measured(order: Order, out: Path) -> Result:
    earlier = _earlier(order, out)
    if earlier is not None:
        return earlier
    for verb in ("make", "measure") if order.recipe is not None else ("measure",):
        command = [sys.executable, "-P", "-m", "evals.benchmark.perception_worker", verb, str(out)]
        done = subprocess.run(
            command, input=order.model_dump_json(), capture_output=True, text=True, check=False,
            env=worker_environment(),
        )  # fmt: skip
        if done.returncode != 0:
            lines = done.stderr.strip().splitlines() or [f"ended with status {done.returncode}"]
            return Result(order=order, figures=_failed(order.name, lines[-1]))
    found = _earlier(order, out)
    if found is None:
        raise InputError(f"{result_file(out, order.name)} changed while it was read", "name another --out")
    return found


def _earlier(order: Order, out: Path) -> Result | None:
    """The result of the same order, if there is one."""
    try:
        result = Result.model_validate_json(result_file(out, order.name).read_text(encoding="utf-8"))
    except (OSError, ValidationError):
        return None
    return result if result.order == order and result_file(out, order.name).with_suffix(".png").exists() else None


def _failed(name: str, error: str) -> SceneFigures:
    nothing = SegmentationScore(
        objects=0, segments=0, hits=(0, 0), iou_of_matched=0.0, iou_of_objects=0.0, split=0, merged=0,
        outline_found=0, outline_segments=0, outline_met=0, outline_objects=0,
    )  # fmt: skip
    return SceneFigures(name=name, score=nothing, error=error)


def _targets(bounds: Sequence[Target]) -> Table:
    shown = Table("figure", "measured", "target", "", title="targets")
    for one in bounds:
        if one.value is not None:
            sign = "<=" if one.smaller_is_better else ">="
            bound = "" if one.bound is None else f"{sign} {one.bound:g}"
            shown.add_row(one.name, f"{one.value:.3g} {one.unit}", bound, "missed" if one.reached is False else "")
    return shown
