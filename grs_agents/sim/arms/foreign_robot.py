"""The arm of a task folder, which may be a stranger's: a worker loads its file before this process does."""

from functools import lru_cache
from pathlib import Path

from grs_agents.sandbox.host.foreign_reader import READING, ForeignReader

_WORKER = "grs_agents.sim.arms.worker"


def check_foreign_robot(path: Path) -> None:
    """See that the arm in an MJCF file can be loaded, within the memory and time that an arm needs.
    Raises InputError: it cannot; or loading it breaks the worker, or takes more."""
    status = path.stat()
    _check_once(path, status.st_mtime_ns, status.st_size)


@lru_cache(maxsize=64)
def _check_once(path: Path, _changed: int, _size: int) -> None:
    with ForeignReader([path.parent], [_WORKER], READING) as reader:
        reader.read(_WORKER, {"robot": str(path)}, f"robot {path}")
