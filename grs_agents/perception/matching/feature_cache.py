"""What was worked out of an asset's files, kept in the user's cache until they change."""

import hashlib
import io
import os
from contextlib import suppress
from pathlib import Path
from typing import Any
from zipfile import BadZipFile

import numpy as np
import numpy.typing as npt

from grs_agents.base.errors import InputError
from grs_agents.base.files import write_bytes
from grs_agents.library.library import Library

Arrays = dict[str, npt.NDArray[Any]]
_VERSION = "3"  # of what is kept; another one makes all anew


def hash_asset_files(name: str, library: Library) -> str:
    """A hash of the files an asset is drawn from."""
    whole = hashlib.sha256(_VERSION.encode() + library.asset_path(name).read_bytes())
    for shape in library.load_object_model(name).visuals:
        for file in (shape.mesh, shape.texture):
            whole.update(b"\0" if file is None else library.mesh_or_texture_path(file).read_bytes())
    return whole.hexdigest()


def load_cached_arrays(key: str) -> Arrays | None:
    """The arrays kept under a key; ``None`` where there are none, or broken ones."""
    try:
        with np.load(_cache_file_path(key), allow_pickle=False) as found:
            return {name: found[name] for name in found.files}
    except (OSError, ValueError, KeyError, EOFError, BadZipFile, RuntimeError):  # the last: a user without a home
        return None


def save_cached_arrays(key: str, arrays: Arrays) -> None:
    """Keep arrays under a key; where the cache cannot be written they are worked out again next time."""
    data = io.BytesIO()
    np.savez(data, allow_pickle=False, **arrays)
    with suppress(InputError, RuntimeError):
        write_bytes(_cache_file_path(key), data.getvalue())


def cache_folder_path() -> Path:
    """The user's cache, as the XDG base directory specification has it."""
    base = os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
    return Path(base) / "grs-agents" / "looks"


def _cache_file_path(key: str) -> Path:
    return cache_folder_path() / f"{key}.npz"
