"""How good perception is: segments, boxes, poses, frame, time and memory, on labelled or synthesised scenes."""

from collections.abc import Sequence
from pathlib import Path

from evals.benchmark.perception_runs import MeasurementOptions, orders_of, run_orders, synthesised_orders
from evals.synthesis.recipe_options import add_recipe_options, recipes_from_options
from grs_agents.config import load_config
from grs_agents.perception import RULES
from grs_agents.runs import positive_int
from grs_agents.terminal import EscapingParser


def main(arguments: Sequence[str]) -> int:
    """Measure the scenes named, or synthesised ones.

    Returns:
        0 if every scene could be measured, 1 if not.

    Raises:
        InputError: a folder holds no labelled scene.
    """
    parser = EscapingParser(prog="grs eval perception", description=__doc__)
    parser.add_argument("--out", type=Path, default=Path("runs/eval-perception"), help="where figures go")
    parser.add_argument(
        "--scenes",
        action="append",
        default=[],
        metavar="DIR",
        help="folder of scenes with labels.png, or bop:ROOT/SPLIT; repeat",
    )
    parser.add_argument("--images", type=positive_int, default=50, help="of a BOP data set, spread evenly")
    add_recipe_options(parser)
    parser.add_argument(
        "--segment", default=load_config(None).config.tools.segment, metavar="TOOL", help="what segments"
    )
    parser.add_argument(
        "--model", default=load_config(None).config.segment.model, metavar="DIR", help="model of that tool's own"
    )
    parser.add_argument(
        "--without", action="append", default=[], choices=RULES, metavar="RULE", help="turn a rule of segmentation off"
    )
    parser.add_argument("--set", action="append", default=[], dest="settings", metavar="KEY=VALUE", help="of the runs")
    parser.add_argument(
        "--repeats", type=positive_int, default=3, help="how often the work is timed: 3; the least counts"
    )
    parser.add_argument("--workers", type=positive_int, default=2, help="scenes at a time")
    parser.add_argument("--json", action="store_true", help="print the figures as JSON")
    options = parser.parse_args(arguments)
    rules, settings = tuple(options.without), tuple(options.settings)
    work = MeasurementOptions(options.segment, options.seed, options.repeats, options.model, rules, settings)
    orders = [
        *orders_of(options.scenes, work, options.images),
        *synthesised_orders(recipes_from_options(options), options.out, work),
    ]
    return run_orders(orders, options.out, options.workers, options.json)
