"""``grs play``."""

from pathlib import Path
from typing import TYPE_CHECKING

from grs_agents.cli.show import library_of
from grs_agents.run import RunRecord, read_record
from grs_agents.terminal import say
from grs_agents.trace import Rollout, read_events

if TYPE_CHECKING:
    from grs_agents.views.film.film import Shot


def shot_of(folder: Path, record: RunRecord, event: Rollout) -> "Shot":
    """A rollout of a run and how to look at it."""
    from grs_agents.views.film.film import Shot

    return Shot(folder.resolve(), event, library_of(folder), str(record.config.get("robot", "ur5e")))


def play_run(folder: Path, out: Path | None, seed: int | None) -> int:
    """Play a rollout of a run in MuJoCo's window, or into the file ``out``.

    Returns:
        The exit status.

    Raises:
        InputError: the folder holds no run with such a rollout, or the file cannot be written.
        GrsError: there is nothing to draw with.
    """
    from grs_agents.views import working
    from grs_agents.views.film.film import rollout_of, watch, write_film

    record = read_record(folder)
    shot = shot_of(folder, record, rollout_of(read_events(folder / "events.jsonl"), folder, seed))
    if out is None:
        return watch(shot)
    with working("drawing the film") as show:
        frames = write_film(shot, out, show=show)
    say(f"{out}: seed {shot.event.seed}, {frames} frames, {out.stat().st_size / 2**20:.1f} MiB")
    return 0
