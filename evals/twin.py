"""Likeness of twins and photos: a contact sheet of scenes for a person to mark, from 0 to 5 each."""

from collections.abc import Sequence
from functools import partial
from pathlib import Path

import numpy as np

from evals.benchmark.contact_sheet import Picture, captioned_row, twin_pictures, write_pages
from evals.benchmark.perception_runs import unique_names
from evals.benchmark.scene_run import ASIDE
from evals.benchmark.types import Order, run_folder
from evals.benchmark.worker_processes import error_of, run_worker
from grs_agents.base import Frozen, content
from grs_agents.perception.reading.scene_source import check_scene_source, read_scene
from grs_agents.perception.types import read_scene_description
from grs_agents.runs.experiment_run import ExperimentParser
from grs_agents.runs.experiments import positive_int

_MARK = "mark 0-5: ____"


class _Twin(Frozen):
    error: str  # reason of a missing twin; empty otherwise


def main(arguments: Sequence[str]) -> int:
    """Comprehend scenes and write the sheet: photo, twin from the photo's camera, twin from aside; a row for each.

    Returns:
        0 if every scene has a twin, 1 if not.

    Raises:
        InputError: there is no such scene.
    """
    second = f"The second view of a twin is from {ASIDE:.0f} degrees aside."
    parser = ExperimentParser("twin", f"{__doc__} {second}")
    parser.add_argument("scenes", nargs="+", metavar="SCENE", help="as `grs scene` takes it, or a folder of folders")
    parser.add_argument("--workers", type=positive_int, default=2, help="scenes at a time")
    experiment = parser.start(arguments)
    out = experiment.options.out
    overlays = tuple(str(root) for root in content.content_search_roots()[:-1])
    sources = [source for scene in experiment.options.scenes for source in _scenes_in(Path(scene))]
    for source in sources:
        check_scene_source(source)
    orders = [
        Order(name=name, source=str(source), tool="", settings=experiment.settings, content=overlays)
        for name, source in zip(unique_names(sources), sources, strict=True)
    ]

    def comprehend(order: Order) -> _Twin:
        done = run_worker("perception_worker", ("comprehend", str(out)), order.model_dump_json())
        return _Twin(error=error_of(done))

    work = {f"{order.name} {order.source}": partial(comprehend, order) for order in orders}
    twins = experiment.make_or_reuse_rows(_Twin, work, workers=experiment.options.workers, choosing=("scenes",))
    pages = write_pages(out, [_row(out, order, twin.error) for order, twin in zip(orders, twins, strict=True)])
    table = [{"scene": order.name, "error": twin.error} for order, twin in zip(orders, twins, strict=True)]
    experiment.tell(table, f"{', '.join(pages)} are in {out}", pages=pages)
    return 1 if any(twin.error for twin in twins) else 0


def _scenes_in(scene: Path) -> list[Path]:
    """The scene folders in a folder, or the scene itself."""
    inside = sorted(file.parent for file in scene.glob("*/camera.json")) if scene.is_dir() else []
    return inside or [scene]


def _row(out: Path, order: Order, error: str) -> Picture:
    run = run_folder(out, order.name)
    photo, twins = read_scene(Path(order.source)).rgb, twin_pictures(run)
    if error:
        return captioned_row(f"{order.name}   {error}", [photo, *[np.full_like(photo, 255)] * 2])
    scene = read_scene_description(run / "scene.json")
    shapes = sum(not item.matched for item in scene.objects)
    coverage = "" if scene.coverage is None else f"   coverage {scene.coverage.share:.2f}"
    words = f"{order.name}   {len(scene.objects)} objects, {shapes} of them without an asset{coverage}   {_MARK}"
    return captioned_row(words, [photo, *twins])
