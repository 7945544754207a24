"""The run folder: made new, or opened again to resume."""

import re
from datetime import UTC, datetime
from pathlib import Path

from grs_agents.errors import InputError
from grs_agents.files import unwritable
from grs_agents.run.record import FILE, RunRecord, read_record


def new_folder(name: str, seed: int, out: Path | None) -> Path:
    """Make the folder of a new run: ``out``, or ``runs/<time>-<name>-<seed>``.

    Raises:
        InputError: the folder already holds a run or other files, or cannot be written.
    """
    if out is None:
        slug = re.sub(r"[^A-Za-z0-9_]+", "-", name).strip("-") or "scene"
        stamp = datetime.now(UTC).strftime("%Y%m%d-%H%M%S")
        base = Path("runs") / f"{stamp}-{slug}-{seed}"
        out, number = base, 1
        while out.exists():
            number += 1
            out = base.with_name(f"{base.name}-{number}")
    if (out / FILE).exists():
        raise InputError(f"{out} already holds a run", "go on with it with --resume, or name another folder with --out")
    try:
        if out.is_dir() and any(out.iterdir()):
            raise InputError(f"{out} is not empty", "name a new or empty folder with --out")
        out.mkdir(parents=True, exist_ok=True)
        probe = out / ".writable"
        probe.write_bytes(b"")
        probe.unlink()
    except OSError as error:
        raise unwritable(out, error) from error
    return out


def old_folder(out: Path | None, source: Path, command: str) -> tuple[Path, RunRecord]:
    """Open the folder of an earlier run of the same scene by the same ``command``.

    Raises:
        InputError: no folder is named, it holds no run, or one of another scene or command.
    """
    if out is None:
        raise InputError("--resume needs the folder of the run", "name it with --out DIR")
    record = read_record(out)
    if Path(record.source).resolve() != source.resolve():
        raise InputError(
            f"{out} is a run of {record.source}, not of {source}", "resume it with the scene it was made from"
        )
    if record.command != command:
        raise InputError(
            f"{out} was made by `grs {record.command}`, not by `grs {command}`", "name another folder with --out"
        )
    return out, record
