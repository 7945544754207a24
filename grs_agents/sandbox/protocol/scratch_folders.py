"""Scratch folders: a folder for each worker, removed afterwards whatever its content."""

import os
import tempfile
import time
from contextlib import suppress
from pathlib import Path

_PREFIX = "grs-scratch-"
_SETTLED_SECONDS = 60.0
_FOLDER = os.O_RDONLY | os.O_DIRECTORY | os.O_NOFOLLOW


class Scratch:
    """A fresh folder, ``path``, that only this user can enter; it is locked for as long as its host lives."""

    def __init__(self) -> None:
        self.path = Path(tempfile.mkdtemp(prefix=_PREFIX)).resolve()
        self._lock = os.open(self.path, os.O_RDONLY | os.O_DIRECTORY)
        _acquire_folder_lock(self._lock)

    def remove(self) -> None:
        """Delete the folder; call it once."""
        remove_folder(self.path)
        os.close(self._lock)


def remove_orphaned_folders() -> None:
    """Delete the scratch folders of this user whose host was killed: those without a lock."""
    for folder in Path(tempfile.gettempdir()).glob(f"{_PREFIX}*"):
        with suppress(OSError):
            facts = folder.lstat()
            if facts.st_uid != os.getuid() or time.time() - facts.st_mtime < _SETTLED_SECONDS:
                continue
            lock = os.open(folder, _FOLDER)
            try:
                _acquire_folder_lock(lock)
                remove_folder(folder)
            finally:
                os.close(lock)


def _acquire_folder_lock(descriptor: int) -> None:
    """Lock an open folder; ``OSError`` if another process holds the lock."""
    import fcntl  # here, since Windows lacks it: there this package can be imported but has no worker

    fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)


def remove_folder(folder: Path) -> None:
    """Delete ``folder`` with its content, if the system permits."""
    with suppress(OSError):
        folder.chmod(0o700)
        delete_folder_contents(folder)
        folder.rmdir()


def delete_folder_contents(folder: Path) -> None:
    """Delete all that is in ``folder``, folders without permissions and nested thousands deep too; links stay unread.

    Folders are opened relative to their parents and left through ``..``, so that no path grows too long and nothing
    recurses. Nothing else may be at work in there.
    """
    here = os.open(folder, _FOLDER)
    way = [("", _delete_files_in_folder(here))]
    try:
        while len(way) > 1 or way[-1][1]:
            name, folders = way[-1]
            inner = folders.pop() if folders else ".."
            if inner != "..":
                with suppress(OSError):
                    os.chmod(inner, 0o700, dir_fd=here)
                    here = _switch_to_folder(here, inner)
                    way.append((inner, _delete_files_in_folder(here)))
                continue
            here = _switch_to_folder(here, inner)
            way.pop()
            with suppress(OSError):
                os.rmdir(name, dir_fd=here)
    finally:
        os.close(here)


def _switch_to_folder(here: int, name: str) -> int:
    """Open the folder ``name`` of the descriptor ``here``, which is closed."""
    there = os.open(name, _FOLDER, dir_fd=here)
    os.close(here)
    return there


def _delete_files_in_folder(descriptor: int) -> list[str]:
    """Delete the entries of a folder except its folders. Returns: the names of these."""
    os.fchmod(descriptor, 0o700)
    folders: list[str] = []
    for entry in list(os.scandir(descriptor)):
        if entry.is_dir(follow_symlinks=False):
            folders.append(entry.name)
            continue
        with suppress(OSError):
            os.unlink(entry.name, dir_fd=descriptor)
    return folders
