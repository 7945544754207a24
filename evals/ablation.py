"""The paper's Table 2: rewards of the trusted oracle for graphs without router, fixes or image."""

from collections.abc import Sequence

from evals.benchmark.ablation_runs import make_runs, make_scenes, tell_figures
from evals.synthesis import Recipe, recipes
from grs_agents.base import content
from grs_agents.base.errors import UnknownNameError
from grs_agents.runs.batch.scene_list import list_scenes
from grs_agents.runs.experiment_run import ExperimentParser
from grs_agents.runs.experiments import positive_int

GRAPHS = "grs,no_router,no_fix,llm_only"


def main(arguments: Sequence[str]) -> int:
    """Run every graph on every scene with the same seeds, and measure each resulting program.

    Returns:
        0 if every run ended, 1 if not.

    Raises:
        InputError: a name is no scene or graph.
    """
    parser = ExperimentParser("ablation", __doc__)
    parser.add_argument("scenes", nargs="*", help="as grs batch takes them; made ones by default")
    parser.add_argument("--synthesised", type=positive_int, default=10, metavar="N", help="scenes to make: 10")
    parser.add_argument("--runs", type=positive_int, default=10, help="of each graph on each scene, with seeds from 0")
    parser.add_argument("--graphs", default=GRAPHS, help=f"with commas: {GRAPHS}")
    parser.add_argument("--workers", type=positive_int, default=2, help="runs at a time")
    parser.add_argument("--timeout", type=float, default=600, help="seconds before a run is killed")
    experiment = parser.start(arguments)
    options = experiment.options
    graphs = [name.strip() for name in options.graphs.split(",") if name.strip()]
    for name in graphs:
        if name not in content.content_names("graphs"):
            raise UnknownNameError("graph", name, content.content_names("graphs"))
    scenes = (
        list_scenes(options.scenes)
        if options.scenes
        else tuple(
            map(str, make_scenes(recipes(options.synthesised, 0, Recipe(objects=15)), options.out.resolve() / "scenes"))
        )
    )
    measured = make_runs(scenes, graphs, experiment)
    tell_figures(measured, experiment)
    return 0 if all(run.status in ("accepted", "rejected") for run in measured) else 1
