"""How good perception is: segments, boxes, poses, frame, time and memory, on labelled or synthesised scenes."""

import argparse
from collections.abc import Sequence
from pathlib import Path

from evals.benchmark.perception_runs import MeasurementOptions, orders_of, run_orders, synthesised_orders
from evals.synthesis.scene import recipes
from grs_agents.config import load_config
from grs_agents.perception import RULES
from grs_agents.runs import positive_int
from grs_agents.terminal import VisibleParser


def main(arguments: Sequence[str]) -> int:
    """Measure the scenes named, or synthesised ones.

    Returns:
        0 if every scene could be measured, 1 if not.

    Raises:
        InputError: a folder holds no labelled scene.
    """
    parser = VisibleParser(prog="grs eval perception", description=__doc__)
    parser.add_argument("--out", type=Path, default=Path("runs/eval-perception"), help="where figures go")
    parser.add_argument(
        "--scenes",
        action="append",
        default=[],
        metavar="DIR",
        help="folder of scenes with labels.png, or bop:ROOT/SPLIT; repeat",
    )
    parser.add_argument("--images", type=positive_int, default=50, help="of a BOP data set, spread evenly")
    parser.add_argument(
        "--synthesised", type=natural, default=None, metavar="N", help="scenes to make: 10 without --scenes"
    )
    parser.add_argument(
        "--objects", type=positive_int, default=15, help="things in a made scene, four of them distractors"
    )
    parser.add_argument("--size", type=size, default=(640, 480), metavar="WxH", help="of the made pictures: 640x480")
    parser.add_argument("--seed", type=natural, default=0, help="of the made scenes")
    parser.add_argument(
        "--segment", default=load_config(None).config.tools.segment, metavar="TOOL", help="what segments"
    )
    parser.add_argument(
        "--model", default=load_config(None).config.segment.model, metavar="DIR", help="model of that tool's own"
    )
    parser.add_argument(
        "--without", action="append", default=[], choices=RULES, metavar="RULE", help="turn a rule of segmentation off"
    )
    parser.add_argument(
        "--repeats", type=positive_int, default=3, help="how often the work is timed: 3; least and median count"
    )
    parser.add_argument("--workers", type=positive_int, default=2, help="scenes at a time")
    parser.add_argument("--json", action="store_true", help="print the figures as JSON")
    options = parser.parse_args(arguments)
    count = options.synthesised if options.synthesised is not None else 0 if options.scenes else 10
    made = recipes(count, options.seed, options.objects, size=options.size)
    work = MeasurementOptions(options.segment, options.seed, options.repeats, options.model, tuple(options.without))
    orders = [
        *orders_of(options.scenes, work, options.images),
        *synthesised_orders(made, options.out, work),
    ]
    return run_orders(orders, options.out, options.workers, options.json)


def size(text: str) -> tuple[int, int]:
    """``640x480`` as width and height, for ``argparse``."""
    width, height = (positive_int(part) for part in text.split("x"))
    return width, height


def natural(text: str) -> int:
    """A whole number from 0, for ``argparse``."""
    number = int(text)
    if number < 0:
        raise argparse.ArgumentTypeError(f"{number} is less than 0")
    return number
