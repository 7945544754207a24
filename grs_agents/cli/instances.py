"""``grs instances``."""

import re
from pathlib import Path

from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn
from rich.text import Text

from grs_agents.base import terminal
from grs_agents.base.errors import InputError
from grs_agents.base.files import refuse_link
from grs_agents.base.terminal import print_escaped, print_json
from grs_agents.sim.variation.types import Variation
from grs_agents.tasks.varied_instances import Manifest, make_varied_instances

_MOST_SEEDS = 100_000
_LARGEST_SEED = 2**32
_SHOWN = 5


def parse_seed_range(text: str) -> range:
    """The seeds that ``FIRST:END`` names, END not among them; ``N`` is that seed alone."""
    match = re.fullmatch(r"(\d{1,10})(?::(\d{1,10}))?", text)
    first = int(match[1]) if match else 0
    end = (int(match[2]) if match[2] else first + 1) if match else 0
    if not 0 < end - first <= _MOST_SEEDS or end > _LARGEST_SEED:
        raise InputError(
            f"--seeds {text!r} is no range of seeds", f"give FIRST:END, as 0:200; at most {_MOST_SEEDS} below 2^32"
        )
    return range(first, end)


def write_instances(run: Path, seeds: str, variation: Variation, out: Path | None, workers: int, as_json: bool) -> int:
    """Make varied instances of a run, with progress, and print what came of it; 1 if none of them is solved."""
    wanted = parse_seed_range(seeds)
    folder = out or refuse_link(run.resolve().with_name(f"{run.resolve().name}-instances"))
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    with Progress(*columns, console=terminal.make_console(error=True)) as progress:
        row = progress.add_task("instances", total=len(wanted))

        def update_instance_progress(manifest: Manifest) -> None:
            there = len(manifest.seeds.intersection(wanted))
            progress.update(row, completed=there, description=f"instances, {len(manifest.left_out)} left out")

        try:
            made = make_varied_instances(run, wanted, variation, folder, workers, update_instance_progress)
        except KeyboardInterrupt:
            print_escaped("interrupted; the same command goes on", error=True)
            raise
    _print_instances_made(folder, made, as_json)
    return 0 if made.instances else 1


def _print_instances_made(folder: Path, made: Manifest, as_json: bool) -> None:
    if as_json:
        print_json({"folder": str(folder), **made.model_dump(mode="json")})
        return
    console = terminal.make_console()
    console.print(Text(f"{folder}: {len(made.instances)} instances that the expert solves", style="bold"))
    for one in made.left_out[:_SHOWN]:
        console.print(Text(f"  left out: seed {one.seed}: {one.outcome}: {one.detail}"))
    if len(made.left_out) > _SHOWN:
        console.print(Text(f"  and {len(made.left_out) - _SHOWN} more, see manifest.json"))
