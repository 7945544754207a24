"""Whether twins look like their photos: a contact sheet of scenes for a person to mark, from 0 to 5 each."""

import argparse
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from evals.benchmark.contact_sheet import Picture, captioned_row, twin_pictures, write_pages
from evals.benchmark.perception_runs import unique_names
from evals.benchmark.scene_run import ASIDE
from evals.benchmark.types import Order, run_folder
from evals.benchmark.worker_processes import error_of, run_jobs, run_worker
from grs_agents import content
from grs_agents.perception import check_scene_source, read_scene, read_scene_description
from grs_agents.runs import positive_int
from grs_agents.terminal import EscapingParser, print_escaped

_MARK = "mark 0-5: ____"


def main(arguments: Sequence[str]) -> int:
    """Comprehend scenes and write the sheet: photo, twin from the photo's camera, twin from aside; a row for each.

    Returns:
        0 if every scene has a twin, 1 if not.

    Raises:
        InputError: there is no such scene.
    """
    second = f"The second view of a twin is from {ASIDE:.0f} degrees aside."
    parser = EscapingParser(prog="grs eval twin", description=f"{__doc__} {second}")
    parser.add_argument("scenes", nargs="+", metavar="SCENE", help="as `grs scene` takes it, or a folder of folders")
    parser.add_argument("--out", type=Path, default=Path("runs/eval-twin"), help="where runs and pages go")
    parser.add_argument("--set", action="append", default=[], dest="settings", metavar="KEY=VALUE", help="of the runs")
    parser.add_argument("--workers", type=positive_int, default=2, help="scenes at a time")
    options = parser.parse_args(arguments)
    orders = _orders(options)

    def comprehend(order: Order) -> str:
        return error_of(run_worker("perception_worker", ("comprehend", str(options.out)), order.model_dump_json()))

    errors = run_jobs("scenes", orders, comprehend, options.workers, lambda order: order.name)
    rows = [_row(options.out, order, error) for order, error in zip(orders, errors, strict=True)]
    print_escaped(f"{', '.join(write_pages(options.out, rows))} are in {options.out}")
    return 1 if any(errors) else 0


def _orders(options: argparse.Namespace) -> list[Order]:
    overlays, settings = tuple(str(root) for root in content.content_search_roots()[:-1]), tuple(options.settings)
    sources = [source for scene in options.scenes for source in _scenes_in(Path(scene))]
    for source in sources:
        check_scene_source(source)
    return [
        Order(name=name, source=str(source), tool="", settings=settings, content=overlays)
        for name, source in zip(unique_names(sources), sources, strict=True)
    ]


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
    told = "" if scene.coverage is None else f"   coverage {scene.coverage.share:.2f}"
    words = f"{order.name}   {len(scene.objects)} objects, {shapes} of them without an asset{told}   {_MARK}"
    return captioned_row(words, [photo, *twins])
