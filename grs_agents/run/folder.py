"""The run folder: made new, or opened again to resume."""

import fcntl
import os
import re
from collections.abc import Generator
from contextlib import contextmanager
from datetime import UTC, datetime
from pathlib import Path

from grs_agents.errors import InputError
from grs_agents.files import unwritable
from grs_agents.run.record import FILE, RunRecord, read_record

LOCK = ".lock"
"""Locked by the process that runs in the folder, whose number it holds."""


def new_folder(name: str, seed: int, out: Path | None) -> Path:
    """Make the folder of a new run: ``out``, or ``runs/<time>-<name>-<seed>``.

    Raises:
        InputError: the folder already holds a run or other files, or cannot be written.
    """
    if out is not None:
        refuse_used(out)
        return _made(out, exist_ok=True)
    slug = re.sub(r"[^A-Za-z0-9_]+", "-", name).strip("-") or "scene"
    stamp = datetime.now(UTC).strftime("%Y%m%d-%H%M%S")
    base = folder = Path("runs") / f"{stamp}-{slug}-{seed}"
    number = 1
    while True:
        try:
            return _made(folder, exist_ok=False)
        except FileExistsError:
            number += 1
            folder = base.with_name(f"{base.name}-{number}")


def _made(folder: Path, exist_ok: bool) -> Path:
    try:
        folder.mkdir(parents=True, exist_ok=exist_ok)
    except FileExistsError as error:
        if not exist_ok:
            raise
        raise unwritable(folder, error) from error
    except OSError as error:
        raise unwritable(folder, error) from error
    return folder


def refuse_used(folder: Path) -> None:
    """See that a folder is new or empty.

    Raises:
        InputError: it holds a run or other files.
    """
    if (folder / FILE).exists():
        raise InputError(f"{folder} already holds a run", "go on with it with --resume, or name another with --out")
    try:
        if folder.is_dir() and any(entry.name != LOCK for entry in folder.iterdir()):
            raise InputError(f"{folder} is not empty", "name a new or empty folder with --out")
    except OSError as error:
        raise unwritable(folder, error) from error


@contextmanager
def held(folder: Path) -> Generator[None]:
    """Let no other process run in ``folder`` until the block ends. The kernel lets go of a process that is killed.

    Who only looks at a run does not need this.

    Raises:
        InputError: another process runs in it, or it cannot be written.
    """
    try:
        descriptor = os.open(folder / LOCK, os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW, 0o644)
    except OSError as error:
        raise unwritable(folder / LOCK, error) from error
    try:
        _lock(descriptor, folder)
        yield
    finally:
        os.close(descriptor)


def _lock(descriptor: int, folder: Path) -> None:
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        os.ftruncate(descriptor, 0)
        os.pwrite(descriptor, str(os.getpid()).encode(), 0)
    except BlockingIOError as error:
        holder = os.pread(descriptor, 20, 0)
        who = f"process {int(holder)}" if holder.isdigit() else "another process"
        raise InputError(f"{folder} is in use by {who}", "wait until it ends, or name another --out") from error
    except OSError as error:
        raise unwritable(folder / LOCK, error) from error


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
