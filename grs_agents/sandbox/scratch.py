"""Scratch folders: one for each worker, gone afterwards whatever was left in them."""

import os
import tempfile
import time
from contextlib import suppress
from pathlib import Path
from uuid import uuid4

_PREFIX = "grs-scratch-"
_SETTLED_SECONDS = 60.0


class Scratch:
    """A fresh folder that only this user can enter; it is locked for as long as its host lives.

    Attributes:
        path: the folder.
    """

    def __init__(self) -> None:
        self.path = Path(tempfile.mkdtemp(prefix=_PREFIX)).resolve()
        self._lock = os.open(self.path, os.O_RDONLY | os.O_DIRECTORY)
        _lock(self._lock)

    def remove(self) -> None:
        """Delete the folder; call it once."""
        remove_folder(self.path)
        os.close(self._lock)


def sweep() -> None:
    """Delete the scratch folders of this user whose host was killed: those that nobody has locked."""
    for folder in Path(tempfile.gettempdir()).glob(f"{_PREFIX}*"):
        with suppress(OSError):
            facts = folder.lstat()
            if facts.st_uid != os.getuid() or time.time() - facts.st_mtime < _SETTLED_SECONDS:
                continue
            lock = os.open(folder, os.O_RDONLY | os.O_DIRECTORY | os.O_NOFOLLOW)
            try:
                _lock(lock)
                remove_folder(folder)
            finally:
                os.close(lock)


def _lock(descriptor: int) -> None:
    """Take the lock on an open folder.

    Raises:
        OSError: somebody else has it.
    """
    import fcntl  # here, since Windows lacks it, where this package can be imported but has no worker

    fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)


def remove_folder(folder: Path) -> None:
    """Delete ``folder`` and all that is in it."""
    empty_folder(folder)
    with suppress(OSError):
        folder.rmdir()


def empty_folder(folder: Path) -> None:
    """Delete all that is in ``folder``, folders without permissions and nested thousands deep too; links stay unread.

    Inner folders are moved up before they are emptied, so that no path grows too long and nothing recurses.
    """
    waiting = [folder]
    while waiting:
        current = waiting.pop()
        with suppress(OSError):
            current.chmod(0o700)
            for entry in list(os.scandir(current)):
                with suppress(OSError):
                    _empty(entry, current, folder, waiting)
        if current != folder:
            with suppress(OSError):
                current.rmdir()


def _empty(entry: "os.DirEntry[str]", current: Path, folder: Path, waiting: list[Path]) -> None:
    path = Path(entry.path)
    if not entry.is_dir(follow_symlinks=False):
        path.unlink()
        return
    path.chmod(0o700)
    waiting.append(path if current == folder else path.rename(folder / uuid4().hex))
