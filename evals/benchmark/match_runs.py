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
    one.name: one
    for one in (
        Method(name="features", tool="match_features"),
        Method(name="features-no-ocr", tool="match_features", ocr=False),
        Method(name="features-no-size", tool="match_features", sized=False),
        Method(name="clip", tool="match_clip"),
        Method(name="text", tool="match_text", models=True),
        Method(name="image", tool="match_image", models=True),
        Method(name="both", tool="match_both", models=True),
        Method(name="hybrid", tool="match_hybrid", models=True),
    )
}
"""The ways to match that can be measured."""


def match_orders(
    scenes: Sequence[Order], methods: Sequence[str], models: Sequence[str], runs: int, settings: Sequence[str]
) -> list[MatchOrder]:
    """An order for each scene, method, model and run; methods without a model have the model ``-`` and a single run."""
    rooms = [content.package_root() / room for room in ("perception", "agents")]
    code = content.hash_files(*rooms, content.content_path("tools", "match_features"))
    found: list[MatchOrder] = []
    for name in methods:
        method = METHODS[name]
        for model in models if method.models else ("-",):
            for run in range(runs if method.models else 1):
                found += [
                    MatchOrder(
                        scene=scene.model_copy(update={"fingerprint": scene.fingerprint + code}),
                        method=method,
                        model=model,
                        run=run,
                        settings=tuple(settings),
                    )
                    for scene in scenes
                ]
    return found


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
    costs, out, workers = _prices(prices), experiment.options.out, experiment.options.workers
    _make(orders, out, workers)
    found = run_jobs("matching", orders, lambda order: _matching(order, out), workers, lambda order: order.stem)
    value = write_matchings(out, found, costs)
    write_match_plot(out, value["table"])
    write_match_sheet(out, found)
    experiment.tell(
        value["table"],
        terminal_table("correspondence", SHOWN, value["table"]),
        *(f"{one['test']}, {one['effect']}: H = {one['statistic']:.2f}, p = {one['p']:.3g}" for one in value["tests"]),
        f"table1.md, table1.csv, objects.csv, confusions.csv, f1.png and sheets are in {out}",
        **{name: part for name, part in value.items() if name != "table"},
    )
    for one in found:
        if one.error:
            print_escaped(f"{one.order.stem}: {one.error}", error=True)
    return 0 if all(not one.error for one in found) else 1


def _make(orders: Sequence[MatchOrder], out: Path, workers: int) -> None:
    """Make the scenes that are not there."""
    scenes = {order.scene.name: order.scene for order in orders if order.scene.recipe is not None}
    missing = [scene for scene in scenes.values() if not (Path(scene.source) / "truth.json").exists()]
    run_jobs("making scenes", missing, lambda scene: _make_scene(scene, out), workers, lambda scene: scene.name)


def _make_scene(scene: Order, out: Path) -> None:
    run_worker("perception_worker", ("make", str(out)), scene.model_dump_json())


def _matching(order: MatchOrder, out: Path) -> Matching:
    earlier = _earlier(order, out)
    if earlier is not None:
        return earlier
    if error := error_of(run_worker("match_worker", (str(out),), order.model_dump_json())):
        return Matching(order=order, error=error)
    found = _earlier(order, out)
    if found is None:
        raise InputError(f"{matching_file(out, order)} changed while it was read", "name another --out")
    return found


def _earlier(order: MatchOrder, out: Path) -> Matching | None:
    """The stored outcome of the same order, if any."""
    try:
        found = Matching.model_validate_json(matching_file(out, order).read_text(encoding="utf-8"))
    except (OSError, ValidationError):
        return None
    return found if found.order == order else None


def _prices(stated: Sequence[str]) -> dict[str, tuple[float, float]]:
    found: dict[str, tuple[float, float]] = {}
    for one in stated:
        model, _, numbers = one.rpartition("=")
        try:
            into, out = (float(number) for number in numbers.split(","))
        except ValueError as error:
            raise InputError(f"price {one!r}", "give MODEL=IN,OUT, what a million tokens cost") from error
        found[model] = (into, out)
    return found
