"""Measure correspondence on many scenes: methods x models x runs, each in a process of its own; write the figures."""

from collections.abc import Sequence
from pathlib import Path

from pydantic import ValidationError

from evals.benchmark.match_figures import SHOWN, write_matchings
from evals.benchmark.match_sheet import write_match_plot, write_match_sheet
from evals.benchmark.match_types import Matching, MatchOrder, Method, matching_file
from evals.benchmark.types import Order
from evals.benchmark.worker_processes import error_of, run_jobs, run_worker
from grs_agents.base import content
from grs_agents.base.errors import InputError
from grs_agents.base.terminal import print_escaped
from grs_agents.runs.experiment_run import Experiment
from grs_agents.runs.experiments import terminal_table

METHODS: dict[str, Method] = {
    method.name: method
    for method in (
        Method(name="features", tool="match_features"),
        Method(name="features-no-ocr", tool="match_features", ocr=False),
        Method(name="features-no-size", tool="match_features", sized=False),
        Method(name="clip", tool="match_clip"),
        Method(name="text", tool="match_hybrid", models=True, pictured=False),
        Method(name="image", tool="match_hybrid", models=True, worded=False),
        Method(name="both", tool="match_hybrid", models=True),
    )
}
"""The ways to match that can be measured."""


def match_orders(
    scenes: Sequence[Order], methods: Sequence[str], models: Sequence[str], runs: int, settings: Sequence[str]
) -> list[MatchOrder]:
    """An order for each scene, method, model and run; methods without a model have the model ``-`` and a single run."""
    rooms = [content.package_root() / room for room in ("perception", "agents")]
    code = content.hash_files(*rooms, content.content_path("tools", "match_features"))
    orders: list[MatchOrder] = []
    for name in methods:
        method = METHODS[name]
        for model in models if method.models else ("-",):
            for run in range(runs if method.models else 1):
                orders += [
                    MatchOrder(
                        scene=scene.model_copy(update={"fingerprint": scene.fingerprint + code}),
                        method=method,
                        model=model,
                        run=run,
                        settings=tuple(settings),
                    )
                    for scene in scenes
                ]
    return orders


def run_match_orders(orders: Sequence[MatchOrder], experiment: Experiment, prices: Sequence[str]) -> int:
    """Match every scene in every way, write figures and pictures to the experiment's folder, and print them.

    Stored results of the same scene, method, settings and code are reused, so an interrupted experiment resumes.

    Args:
        orders: the matchings to compute.
        experiment: its folder, and the number of scenes in parallel.
        prices: ``MODEL=IN,OUT``, the costs of a million tokens.

    Returns:
        0 if every scene could be matched, 1 if not.

    Raises:
        InputError: a price cannot be read, or SciPy is not installed.
    """
    out, workers = experiment.options.out, experiment.options.workers
    costs: dict[str, tuple[float, float]] = {}
    for text in prices:
        model, _, numbers = text.rpartition("=")
        try:
            cost_in, cost_out = (float(number) for number in numbers.split(","))
        except ValueError as error:
            raise InputError(f"price {text!r}", "give MODEL=IN,OUT, what a million tokens cost") from error
        costs[model] = (cost_in, cost_out)

    def make(scene: Order) -> None:
        run_worker("perception_worker", ("make", str(out)), scene.model_dump_json())

    scenes = {order.scene.name: order.scene for order in orders if order.scene.recipe is not None}
    missing = [scene for scene in scenes.values() if not (Path(scene.source) / "truth.json").exists()]
    run_jobs("making scenes", missing, make, workers, lambda scene: scene.name)
    matchings = run_jobs("matching", orders, lambda order: _matching(order, out), workers, lambda order: order.stem)
    value = write_matchings(out, matchings, costs)
    write_match_plot(out, value["table"])
    write_match_sheet(out, matchings)
    experiment.tell(
        value["table"],
        terminal_table("correspondence", SHOWN, value["table"]),
        *(
            f"{test['test']}, {test['effect']}: H = {test['statistic']:.2f}, p = {test['p']:.3g}"
            for test in value["tests"]
        ),
        f"table1.md, table1.csv, objects.csv, confusions.csv, f1.png and sheets are in {out}",
        **{name: part for name, part in value.items() if name != "table"},
    )
    for matching in matchings:
        if matching.error:
            print_escaped(f"{matching.order.stem}: {matching.error}", error=True)
    return 0 if all(not matching.error for matching in matchings) else 1


def _matching(order: MatchOrder, out: Path) -> Matching:
    earlier = _earlier(order, out)
    if earlier is not None:
        return earlier
    if error := error_of(run_worker("match_worker", (str(out),), order.model_dump_json())):
        return Matching(order=order, error=error)
    matching = _earlier(order, out)
    if matching is None:
        raise InputError(f"{matching_file(out, order)} changed while it was read", "name another --out")
    return matching


def _earlier(order: MatchOrder, out: Path) -> Matching | None:
    """The stored outcome of the same order, if any."""
    try:
        matching = Matching.model_validate_json(matching_file(out, order).read_text(encoding="utf-8"))
    except (OSError, ValidationError):
        return None
    return matching if matching.order == order else None
