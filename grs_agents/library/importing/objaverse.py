"""Objaverse: metadata first; a model is downloaded only when it is asked for."""

import contextlib
import importlib
import shutil
import socket
import sys
import zlib
from collections import defaultdict
from collections.abc import Generator, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, Final, Protocol, cast

from grs_agents.base import Frozen
from grs_agents.base.errors import ConfigError, InputError
from grs_agents.library.importing.asset_discovery import slugify_name
from grs_agents.library.importing.mesh_appearance import split_name_into_words

_COMMONS: Final = ("by", "by-sa", "by-nd", "by-nc", "by-nc-sa", "by-nc-nd")
_LICENSES: Final = {"cc0": "CC0-1.0"} | {name: f"CC-{name.upper()}-4.0" for name in _COMMONS}
_FAULTS: Final = (OSError, EOFError, ValueError, KeyError, TypeError, zlib.error)
"""Errors of the package if it is offline or its earlier downloads are cut off."""
_TIMEOUT: Final = 60.0
"""Seconds without a byte after which a host is given up; the package itself waits without limit."""


class Objaverse(Protocol):
    """The part of the ``objaverse`` package that is used."""

    def load_annotations(self, uids: list[str] | None = None) -> Mapping[str, Mapping[str, Any]]:
        """Annotations of objects by identifier: name, tags, license, viewerUrl and more."""
        ...

    def load_objects(self, uids: list[str], download_processes: int = 1) -> Mapping[str, str]:
        """Download objects; the paths of their GLB files by identifier."""
        ...


class ObjaverseEntry(Frozen):
    """Metadata of an object before its download."""

    uid: str  # its identifier
    title: str  # as its author calls it
    license: str  # SPDX for Creative Commons licences
    author: str = ""
    faces: int = 0  # of its mesh; 0 if unknown
    score: int = 0  # matches of the wanted words in its title and tags


def load_objaverse_package() -> Objaverse:
    """The ``objaverse`` package; a `ConfigError` if it is not installed."""
    try:
        return cast(Objaverse, importlib.import_module("objaverse"))
    except ImportError as error:
        remedy = 'run: pip install "grs-agents[objaverse]"'
        raise ConfigError("Objaverse needs the package objaverse, which is not installed", remedy) from error


def search_objaverse(package: Objaverse, words: str, most: int = 50) -> list[ObjaverseEntry]:
    """The objects whose title and tags have all of ``words``, those that say it in the title and are simpler first."""
    wanted = set(split_name_into_words(words))
    if not wanted:
        raise InputError("objaverse: without words", "name what you look for, as in objaverse:red mug")
    with _convert_package_errors("metadata cannot be loaded"):
        entries = [
            entry
            for part in _iterate_annotations(package)
            for uid, annotation in part.items()
            if (entry := _match_annotation(str(uid), annotation, wanted)) is not None
        ]
    return sorted(entries, key=lambda entry: (-entry.score, entry.faces or 10**9, entry.uid))[:most]


def download_objects(package: Objaverse, entries: Sequence[ObjaverseEntry], folder: Path) -> dict[str, ObjaverseEntry]:
    """Fetch objects into a folder, each as a GLB file under a name made of its title; the entries by file name.
    Raises InputError: nothing can be fetched."""
    with _convert_package_errors("models cannot be downloaded"):
        paths = package.load_objects([entry.uid for entry in entries])
    named: dict[str, ObjaverseEntry] = {}
    for entry in entries:
        path = Path(paths.get(entry.uid, ""))
        if path.is_file():
            name = f"{slugify_name(entry.title)[:40]}_{slugify_name(entry.uid)[:8]}.glb"
            shutil.copyfile(path, folder / name)
            named[name] = entry
    return named


@contextlib.contextmanager
def _convert_package_errors(failure: str) -> Generator[None]:
    """Redirect the package's output to standard error, and convert its errors."""
    timeout = socket.getdefaulttimeout()
    socket.setdefaulttimeout(_TIMEOUT)
    try:
        with contextlib.redirect_stdout(sys.stderr):
            yield
    except _FAULTS as error:
        remedy = "see whether this machine is online, and delete what is cut off in ~/.objaverse"
        raise InputError(f"Objaverse's {failure}: {error or type(error).__name__}", remedy) from error
    finally:
        socket.setdefaulttimeout(timeout)


def _iterate_annotations(package: Objaverse) -> Iterator[Mapping[str, Mapping[str, Any]]]:
    """Annotations of all objects, a folder of 5,000 after the other: together they would take many gigabytes."""
    object_paths = getattr(package, "_load_object_paths", None)
    if object_paths is None:
        yield package.load_annotations()
        return
    folders: defaultdict[str, list[str]] = defaultdict(list)
    for uid, path in object_paths().items():
        folders[str(path).rpartition("/")[0]].append(str(uid))
    for folder in sorted(folders):
        yield package.load_annotations(folders[folder])


def _match_annotation(uid: str, annotation: Mapping[str, Any], wanted: set[str]) -> ObjaverseEntry | None:
    """The entry of an object whose title and tags have all wanted words, else None."""
    title = str(annotation.get("name", ""))
    tags = " ".join(str(tag.get("name", "")) for tag in annotation.get("tags", ()))
    in_title, in_tags = wanted & set(split_name_into_words(title)), wanted & set(split_name_into_words(tags))
    if not in_title | in_tags >= wanted:
        return None
    license_ = str(annotation.get("license", ""))
    user = cast(Mapping[str, object], annotation.get("user") or {})
    return ObjaverseEntry(
        uid=uid,
        title=title[:200],
        license=_LICENSES.get(license_, license_ or "unknown"),
        author=str(user.get("displayName", ""))[:100],
        faces=int(annotation.get("faceCount") or 0),
        score=len(wanted) + len(in_title),
    )
