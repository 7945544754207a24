"""A run as one zip file without keys and home folders, for anybody to replay."""

import io
import tempfile
import zipfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from grs_agents.errors import GrsError, InputError
from grs_agents.files import unwritable, write_bytes, write_document
from grs_agents.foreign import read_bytes
from grs_agents.foreign.arrays import words_in
from grs_agents.run.scrub import Scrubber, picture_alone
from grs_agents.terminal import visible

_TEXTS = frozenset({".json", ".jsonl", ".py", ".diff", ".urdf", ".xml", ".obj", ".mtl", ".md", ".txt", ".toml"})
_KINDS = _TEXTS | {".png", ".npz"}
"""What can be looked through."""
_MADE = frozenset({"trace.rrd", "report.html"})
"""Made anew from what is shared."""
_STAMP = (1980, 1, 1, 0, 0, 0)


@dataclass(frozen=True)
class Shared:
    """What was packed.

    Attributes:
        path: the zip file.
        files: how many files it holds.
        size: of the zip file, bytes.
        changed: files from which something was removed.
        left_out: files that were not packed.
    """

    path: Path
    files: int
    size: int
    changed: tuple[str, ...]
    left_out: tuple[str, ...]


def share(folder: Path, out: Path, scrubber: Scrubber, make: Callable[[Path], Sequence[Path]]) -> Shared:
    """Pack a run.

    Args:
        folder: the run.
        out: the zip file.
        scrubber: removes what must not leave.
        make: makes recording and report in a folder that holds the scrubbed run, and names them.

    Raises:
        InputError: a file cannot be read, or the zip file cannot be written.
        GrsError: something that must not leave would still be in it; nothing is written then.
    """
    changed: list[str] = []
    left_out: list[str] = []
    with tempfile.TemporaryDirectory() as temporary:
        copy = Path(temporary) / scrubber.clean(folder.resolve().name)
        for file in sorted(folder.rglob("*")):
            name = file.relative_to(folder)
            if not file.is_file() or file.is_symlink() or name.name in _MADE or name.suffix == ".zip":
                continue
            hidden = any(part.startswith(".") for part in name.parts) or visible(str(name)) != str(name)
            before = None if hidden or name.suffix not in _KINDS else read_bytes(file)
            data = None if before is None else _cleaned(name, before, scrubber)
            if data is None:
                left_out.append(str(name))
                continue
            if data != before:
                changed.append(str(name))
            write_bytes(copy / name, data)
        make(copy)
        packed = _zip(copy, scrubber)
    try:
        write_document(out, packed.getvalue())
    except OSError as error:
        raise unwritable(out, error) from error
    with zipfile.ZipFile(packed) as archive:
        return Shared(out, len(archive.namelist()), len(packed.getvalue()), tuple(changed), tuple(left_out))


def _cleaned(name: Path, data: bytes, scrubber: Scrubber) -> bytes | None:
    """The content to share of a file; None if it is of a kind that cannot be looked through."""
    if name.suffix in _TEXTS:
        return scrubber.clean(data.decode("utf-8", "replace")).encode()
    try:
        if name.suffix == ".png":
            return picture_alone(data)
        return None if scrubber.leaks(" ".join(words_in(data, str(name))).encode()) else data
    except (ValueError, InputError):
        return None


def _zip(copy: Path, scrubber: Scrubber) -> io.BytesIO:
    """The folder as a zip file whose every member was searched once more."""
    packed = io.BytesIO()
    with zipfile.ZipFile(packed, "w", zipfile.ZIP_DEFLATED) as archive:
        for file in sorted(copy.rglob("*")):
            if file.is_file():
                name, data = f"{copy.name}/{file.relative_to(copy).as_posix()}", file.read_bytes()
                for part in (data, name.encode()):
                    if leak := scrubber.leaks(part):
                        raise GrsError(f"not shared: {name} would hold {leak}", "report it, naming the file alone")
                member = zipfile.ZipInfo(name, _STAMP)
                member.compress_type = zipfile.ZIP_DEFLATED
                archive.writestr(member, data)
    packed.seek(0)
    return packed
