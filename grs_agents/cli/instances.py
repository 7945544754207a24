"""``grs instances``."""

import re
from collections.abc import Sequence
from itertools import product
from pathlib import Path

from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn
from rich.table import Table
from rich.text import Text

from grs_agents.base import terminal
from grs_agents.base.errors import InputError
from grs_agents.base.files import refuse_link
from grs_agents.base.menagerie import resolve_menagerie_name
from grs_agents.base.terminal import print_escaped, print_json
from grs_agents.sim.arms.registry import get_arm
from grs_agents.sim.variation.types import Variation
from grs_agents.tasks.task_folder import open_task_folder
from grs_agents.tasks.varied_instances import Robot, VariationManifest, make_varied_instances

_MOST_SEEDS = 100_000
_LARGEST_SEED = 2**32
_SHOWN = 5


def parse_seed_range(text: str) -> range:
    """The seeds of ``FIRST:END``, END excluded; ``N`` is that seed alone."""
    match = re.fullmatch(r"(\d{1,10})(?::(\d{1,10}))?", text)
    first = int(match[1]) if match else 0
    end = (int(match[2]) if match[2] else first + 1) if match else 0
    if not 0 < end - first <= _MOST_SEEDS or end > _LARGEST_SEED:
        raise InputError(
            f"--seeds {text!r} is no range of seeds", f"give FIRST:END, as 0:200; at most {_MOST_SEEDS} below 2^32"
        )
    return range(first, end)


def write_instances(run: Path, seeds: str, variation: Variation, out: Path | None, workers: int, as_json: bool) -> int:
    """Make varied instances of a run with a progress bar, and print a summary. Returns: exit status, 1 if none is
    solved."""
    requested = parse_seed_range(seeds)
    folder = out or _folder_beside(run, "instances")
    with _show_progress() as progress:
        manifest = _make_instances(run, requested, variation, folder, workers, progress, None)
    if as_json:
        print_json({"folder": str(folder), **manifest.model_dump(mode="json")})
        return 0 if manifest.instances else 1
    console = terminal.make_console()
    console.print(Text(f"{folder}: {len(manifest.instances)} instances that the expert solves", style="bold"))
    for item in manifest.left_out[:_SHOWN]:
        console.print(Text(f"  left out: seed {item.seed}: {item.outcome}: {item.detail}"))
    if len(manifest.left_out) > _SHOWN:
        console.print(Text(f"  and {len(manifest.left_out) - _SHOWN} more, see manifest.json"))
    return 0 if manifest.instances else 1


def write_instances_of_robots(
    run: Path,
    seeds: str,
    variation: Variation,
    robots: Sequence[str],
    hands: Sequence[str],
    out: Path | None,
    workers: int,
    as_json: bool,
) -> int:
    """As ``write_instances``, for each robot with each hand, the run's own where none is named: a folder each, and a
    table of which solve the task."""
    requested = parse_seed_range(seeds)
    task = open_task_folder(run)
    own = task.read_instance(task.seeds[0])
    every = product(
        dict.fromkeys(map(resolve_menagerie_name, robots or [own.robot])), dict.fromkeys(hands or [own.hand])
    )
    pairs = [Robot(robot=robot, hand=hand) for robot, hand in every]
    for pair in pairs:
        get_arm(pair.robot, pair.hand)  # before anything is simulated
        alike = [each.robot for each in pairs if each.folder_name == pair.folder_name]
        if len(alike) > 1:
            raise InputError(f"{' and '.join(alike)} have the same name", "rename one: it names a folder of instances")
    folder = out or _folder_beside(run, "robots")
    with _show_progress() as progress:
        manifests = [
            _make_instances(run, requested, variation, folder / pair.folder_name, workers, progress, pair)
            for pair in pairs
        ]
    if as_json:
        rows = [
            {"folder": str(folder / pair.folder_name), **manifest.model_dump(mode="json")}
            for pair, manifest in zip(pairs, manifests, strict=True)
        ]
        print_json({"folder": str(folder), "robots": rows})
    else:
        table = Table("robot", "hand", "solved", "first reason", box=None, pad_edge=False, header_style="bold")
        for pair, manifest in zip(pairs, manifests, strict=True):
            reasons = [f"seed {item.seed}: {item.outcome}: {item.detail}" for item in manifest.left_out]
            solved = f"{len(manifest.instances)} of {len(manifest.seeds)}"
            table.add_row(*map(Text, (Path(pair.robot).name, pair.hand, solved, next(iter(reasons), ""))))
        terminal.make_console().print(table)
    return 0 if any(manifest.instances for manifest in manifests) else 1


def _folder_beside(run: Path, name: str) -> Path:
    return refuse_link(run.resolve().with_name(f"{run.resolve().name}-{name}"))


def _show_progress() -> Progress:
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    return Progress(*columns, console=terminal.make_console(error=True))


def _make_instances(
    run: Path,
    requested: range,
    variation: Variation,
    folder: Path,
    workers: int,
    progress: Progress,
    robot: Robot | None,
) -> VariationManifest:
    name = "instances" if robot is None else robot.folder_name
    row = progress.add_task(name, total=len(requested))

    def update_instance_progress(manifest: VariationManifest) -> None:
        completed = len(manifest.seeds.intersection(requested))
        progress.update(row, completed=completed, description=f"{name}, {len(manifest.left_out)} left out")

    try:
        return make_varied_instances(run, requested, variation, folder, workers, update_instance_progress, robot)
    except KeyboardInterrupt:
        print_escaped("interrupted; the same command goes on", error=True)
        raise
