"""Correspondence of objects in a photo with assets: the paper's Table 1, on synthesised or labelled scenes."""

from collections.abc import Sequence

from evals.benchmark.match_runs import METHODS, match_orders, run_match_orders
from evals.benchmark.perception_runs import MeasurementOptions, orders_of, synthesised_orders
from evals.synthesis.recipe_options import add_recipe_options, recipes_from_options
from grs_agents.base.errors import UnknownNameError
from grs_agents.runs.experiment_run import ExperimentParser
from grs_agents.runs.experiments import positive_int


def main(arguments: Sequence[str]) -> int:
    """Match the named or synthesised scenes, by each method, model and run.

    Returns:
        0 if every scene could be matched, 1 if not.

    Raises:
        InputError: a folder holds no labelled scene, or a method is unknown.
    """
    parser = ExperimentParser("correspondence", __doc__)
    parser.add_argument(
        "--methods", default="features,features-no-ocr,features-no-size", help=f"of {', '.join(METHODS)}; with commas"
    )
    parser.add_argument("--models", default="offline", help="for the methods that ask one; with commas")
    parser.add_argument("--runs", type=positive_int, default=10, help="of each method that asks a model")
    parser.add_argument(
        "--scenes", action="append", default=[], metavar="DIR", help="labelled scenes, or bop:ROOT/SPLIT; repeat"
    )
    parser.add_argument("--images", type=positive_int, default=10, help="of a BOP data set, spread evenly")
    add_recipe_options(parser)
    parser.add_argument("--segment", default="", metavar="TOOL", help="what segments; the true masks by default")
    parser.add_argument("--price", action="append", default=[], metavar="MODEL=IN,OUT", help="of a million tokens")
    parser.add_argument("--workers", type=positive_int, default=2, help="scenes at a time")
    experiment = parser.start(arguments)
    options = experiment.options
    methods = [name.strip() for name in options.methods.split(",") if name.strip()]
    for name in methods:
        if name not in METHODS:
            raise UnknownNameError("method", name, METHODS)
    work = MeasurementOptions(options.segment)
    scenes = [
        *orders_of(options.scenes, work, options.images),
        *synthesised_orders(recipes_from_options(options), options.out, work),
    ]
    models = [name.strip() for name in options.models.split(",") if name.strip()]
    orders = match_orders(scenes, methods, models, options.runs, experiment.settings)
    return run_match_orders(orders, experiment, options.price)
