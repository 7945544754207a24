"""File names by strangers: only small enough files inside the source are opened."""

import re
import unicodedata
from collections.abc import Sequence
from itertools import islice
from pathlib import Path
from typing import Final
from urllib.parse import unquote

from grs_agents.library.importing.types import RefusedError

_CONTROL: Final = 32
_ROOTED: Final = re.compile(r"(?:(?:file|package|model)://|[A-Za-z]:)?(?P<path>.*)", re.DOTALL)
"""A URI of ROS or Gazebo and a path with a drive name a place on the author's machine."""
_TAIL: Final = 8
"""Folders of such a path that are compared with those of the source."""
_ENTRIES: Final = 100_000
"""Files of a folder whose names are compared."""
_LONGEST: Final = 1_000
"""Characters of a name that is looked for."""


class SourceFolder:
    """The folder of a source; files are named relative to it, stay inside it and have at most ``most`` bytes."""

    def __init__(self, root: Path, most: int) -> None:
        self.root, self.most = root.resolve(), most
        self._entries: dict[Path, tuple[dict[str, str], dict[str, str]]] = {}

    def resolve_file(self, name: str, beside: str = "") -> Path:
        """The file called ``name``, relative to the file ``beside`` (itself relative to the root)."""
        by = f"{beside or self.root.name} names "
        if len(name) > _LONGEST:
            raise RefusedError(f"{by}{name[:120]!r}, which has {len(name)} characters", f"use at most {_LONGEST}")
        if not name or name.startswith(("/", "~")) or any(ord(letter) < _CONTROL or letter in ":\\" for letter in name):
            raise RefusedError(f"{by}{name[:120]!r}, which is no relative path", "name files relative to the file")
        resolved = ((self.root / beside).parent / name if beside else self.root / name).resolve()
        if not resolved.is_relative_to(self.root):
            raise RefusedError(f"{by}{name[:120]!r}, which leaves the source folder", "keep files inside the source")
        try:
            exists = resolved.is_file()
        except OSError:  # a part of the name is too long for the file system
            exists = False
        if not exists:
            raise RefusedError(f"{by}{name[:120]!r}, which does not exist", "put the file there")
        if (size := resolved.stat().st_size) > self.most:
            raise RefusedError(f"{name[:120]} has {size} bytes, {self.most} are the most", "simplify it")
        return resolved

    def find_file(self, name: str, beside: str = "") -> Path:
        """`search_file`; errors as `resolve_file` without a match."""
        file = self.search_file(name, beside)
        return self.resolve_file(name, beside) if file is None else self.resolve_file(self.relative_file_name(file))

    def search_file(self, name: str, beside: str = "") -> Path | None:
        """The file that the author of ``beside`` meant by ``name``; None without a match.

        Backslashes, percent codes and letter case are those of other systems. Of an absolute path and of a
        ``package://`` or ``model://`` name the longest end counts that exists beside ``beside`` or in a folder around
        it; of a relative path that does not exist its last part beside ``beside``.
        """
        if len(name) > _LONGEST:
            return None
        home = (self.root / beside).parent if beside else self.root
        for spelled in dict.fromkeys((name.strip().strip('"'), unquote(name.strip().strip('"')))):
            match = _ROOTED.match(spelled.replace("\\", "/"))
            path = match["path"] if match is not None else ""
            rooted = len(path) < len(spelled) or path.startswith(("/", "~"))
            words = [word for word in path.split("/") if word not in ("", ".")]
            if any(ord(letter) < _CONTROL for letter in path) or not words:
                continue
            tails = [words[start:] for start in range(max(0, len(words) - _TAIL), len(words))]
            homes = [place for place in (home, *home.parents) if place.is_relative_to(self.root)]
            places = [(tail, place) for tail in tails for place in homes] if rooted else [(words, home)]
            for tail, place in [*places, (words[-1:], home)]:
                file = self._follow(place, tail)
                if file is not None:
                    return file
        return None

    def _follow(self, place: Path, words: Sequence[str]) -> Path | None:
        """The file that ``words`` lead to from a folder in any letter case; None outside the root or if there is
        none."""
        for word in words:
            if word == "..":
                place = place.parent
                continue
            if not place.is_relative_to(self.root):
                return None
            if place not in self._entries:  # listed once: files name thousands of others that do not exist
                try:
                    names = [entry.name for entry in islice(place.iterdir(), _ENTRIES)]
                except OSError:
                    names = list[str]()
                folded = {_fold_case(entry): entry for entry in reversed(names)}
                self._entries[place] = {entry: entry for entry in names}, folded
            exact, folded = self._entries[place]
            entry = exact.get(word) or folded.get(_fold_case(word))  # also in another letter case or Unicode form
            if entry is None:
                return None
            place /= entry
        place = place.resolve()
        return place if place.is_relative_to(self.root) and place.is_file() else None

    def relative_file_name(self, path: Path) -> str:
        """The name of a file inside the folder."""
        return path.resolve().relative_to(self.root).as_posix()


def _fold_case(name: str) -> str:
    return unicodedata.normalize("NFC", name).casefold()
