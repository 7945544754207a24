"""Names of files from outside: what there is, and of which kind."""

from pathlib import Path

from grs_agents.errors import InputError


def exists(path: Path) -> bool:
    """Whether there is anything under this name, a broken link or an endless one included."""
    try:
        path.lstat()
    except FileNotFoundError:
        return False
    except (OSError, ValueError):
        return True
    return True


def is_folder(path: Path) -> bool:
    """Whether this is a folder; what cannot be looked at is none."""
    try:
        return path.is_dir()
    except (OSError, ValueError):
        return False


def names_in(folder: Path) -> list[str]:
    """The names in a folder, sorted.

    Raises:
        InputError: it cannot be read.
    """
    try:
        return sorted(entry.name for entry in folder.iterdir())
    except OSError as error:
        raise InputError(f"cannot read {folder}: {error.strerror}", "name a folder that you may read") from error
