"""Errors of perception: segments, boxes, poses, frame, time and memory, on labelled or synthesised scenes."""

from collections.abc import Sequence

from evals.benchmark.perception_runs import MeasurementOptions, orders_of, run_orders, synthesised_orders
from evals.synthesis.recipe_options import add_recipe_options, recipes_from_options
from grs_agents.perception.segmentation.configuration import RULES
from grs_agents.runs.experiment_run import ExperimentParser
from grs_agents.runs.experiments import positive_int


def main(arguments: Sequence[str]) -> int:
    """Measure the named or synthesised scenes.

    Returns:
        0 if every scene could be measured, 1 if not.

    Raises:
        InputError: a folder holds no labelled scene.
    """
    parser = ExperimentParser("perception", __doc__)
    parser.add_argument(
        "--scenes",
        action="append",
        default=[],
        metavar="DIR",
        help="folder of scenes with labels.png, or bop:ROOT/SPLIT; repeat",
    )
    parser.add_argument("--images", type=positive_int, default=50, help="of a BOP data set, spread evenly")
    add_recipe_options(parser)
    parser.add_argument("--segment", metavar="TOOL", help="what segments; as configured")
    parser.add_argument("--model", metavar="DIR", help="model of that tool's own; as configured")
    parser.add_argument(
        "--without", action="append", default=[], choices=RULES, metavar="RULE", help="turn a rule of segmentation off"
    )
    parser.add_argument(
        "--repeats", type=positive_int, default=3, help="how often the work is timed: 3; the least counts"
    )
    parser.add_argument("--workers", type=positive_int, default=2, help="scenes at a time")
    experiment = parser.start(arguments)
    options, config = experiment.options, experiment.config
    tool, model = options.segment or config.tools.segment, options.model or config.segment.model
    work = MeasurementOptions(tool, options.seed, options.repeats, model, tuple(options.without), experiment.settings)
    orders = [
        *orders_of(options.scenes, work, options.images),
        *synthesised_orders(recipes_from_options(options), options.out, work),
    ]
    return run_orders(orders, experiment)
