"""``grs share``."""

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any, cast

from grs_agents.cli.reporting import write_report
from grs_agents.cli.show import rebuilt
from grs_agents.files import STANDARD_OUTPUT
from grs_agents.models import PROVIDERS
from grs_agents.run import read_record
from grs_agents.terminal import say


def share_run(folder: Path, out: Path | None) -> None:
    """Pack a run into a zip file without keys and home folders, and say what was removed and left out.

    Raises:
        InputError: the folder holds no run, or the file cannot be written.
        GrsError: something that must not leave could not be removed.
    """
    from grs_agents.run.scrub import scrubber
    from grs_agents.run.share import share
    from grs_agents.views import working

    record = read_record(folder)
    path = out or folder.resolve().with_suffix(".zip")
    with working("removing keys and home folders") as show:
        shared = share(folder, path, scrubber(folder, _key_variables(record.config)), partial(_make, show=show))
    tell = partial(say, error=path == STANDARD_OUTPUT)
    tell(f"{shared.path}: {shared.files} files, {shared.size / 2**20:.1f} MiB")
    if shared.changed:
        tell(f"paths, keys or picture comments were removed from: {', '.join(shared.changed)}")
    if shared.left_out:
        tell(f"left out: {', '.join(shared.left_out)}")


def _make(copy: Path, show: Callable[[str], None]) -> list[Path]:
    show("making the recording")
    made = [rebuilt(copy), write_report(copy, None, show)]
    show("packing")
    return made


def _key_variables(config: dict[str, Any]) -> list[str]:
    """The environment variables from which the run's models take their keys."""
    models = cast("dict[str, dict[str, Any]]", config.get("models") or {})
    named = [str(model.get("key_variable") or "") for model in models.values()]
    return [name for name in (*named, *(provider.key_variable for provider in PROVIDERS.values())) if name]
