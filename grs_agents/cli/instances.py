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
from grs_agents.tasks.varied_instances import VariationManifest, make_varied_instances

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
    folder = out or refuse_link(run.resolve().with_name(f"{run.resolve().name}-instances"))
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    with Progress(*columns, console=terminal.make_console(error=True)) as progress:
        row = progress.add_task("instances", total=len(requested))

        def update_instance_progress(manifest: VariationManifest) -> None:
            completed = len(manifest.seeds.intersection(requested))
            progress.update(row, completed=completed, description=f"instances, {len(manifest.left_out)} left out")

        try:
            manifest = make_varied_instances(run, requested, variation, folder, workers, update_instance_progress)
        except KeyboardInterrupt:
            print_escaped("interrupted; the same command goes on", error=True)
            raise
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
