"""Check of an untrusted arm file, as in a task folder: a worker loads it before this process does."""

from functools import lru_cache
from pathlib import Path

from grs_agents.sandbox.host.foreign_reader import ForeignReader

_WORKER = "grs_agents.sim.arms.worker"


def check_foreign_robot(path: Path) -> None:
    """See that the arm in an MJCF file can be loaded, within the memory and time that an arm needs.
    Raises InputError: it cannot; or loading it breaks the worker, or takes more."""
    status = path.stat()
    _check_once(path, status.st_mtime_ns, status.st_size)


@lru_cache(maxsize=64)
def _check_once(path: Path, _changed: int, _size: int) -> None:
    with ForeignReader(_WORKER, [path.parent]) as reader:
        reader.read({"robot": str(path)}, f"robot {path}")
