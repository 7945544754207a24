"""Sharing of a run as a zip file, without keys and without paths of the machine."""

import io
import json
import os
import re
import struct
import tempfile
import zipfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from grs_agents.base.control_characters import escape_control_chars
from grs_agents.base.errors import GrsError, InputError
from grs_agents.base.files import unwritable_error, write_bytes, write_file_or_stdout
from grs_agents.base.foreign.arrays import read_npz_strings
from grs_agents.base.foreign.files import read_bytes
from grs_agents.runs.hashes import update_hashes_in_copy

REMOVED = "[removed]"
_NAMES = re.compile(r"KEY|TOKEN|SECRET|PASSW|CREDENTIAL", re.IGNORECASE)
_SHORTEST = 8
"""Length from which a variable's value counts as a key; shorter values occur in any text."""
_KEYS = re.compile(
    r"\b(?:sk|pk|rk)-[A-Za-z0-9_\-]{16,}"
    r"|\bAIza[A-Za-z0-9_\-]{30,}"
    r"|\b(?:gh[pousr]|github_pat|hf|glpat|xox[abprs]|lsv2|ls__)[_\-][A-Za-z0-9_\-]{16,}"
    r"|\bAKIA[A-Z0-9]{16}\b"
    r"|(?<![A-Za-z0-9_\-])eyJ[A-Za-z0-9_\-]{8,}\.[A-Za-z0-9_\-]{8,}\.[A-Za-z0-9_\-]{8,}"
    r"|(?<=Bearer )[A-Za-z0-9._~+/\-]{16,}=*"
    r"|(?<=://)[^/\s:@\"']{1,200}:[^/\s@\"']{1,200}(?=@)"
    r"|-----BEGIN [A-Z ]*PRIVATE KEY-----(?:(?!-----BEGIN).)*?-----END [A-Z ]*PRIVATE KEY-----",
    re.DOTALL,
)
_HOMES = re.compile(r"(?:/home/|/Users/|[A-Za-z]:(?:\\{1,2}|/)Users(?:\\{1,2}|/))[^/\\\s\"'<>:,;)\]}]+")
_PNG = b"\x89PNG\r\n\x1a\n"
_PICTURE_CHUNKS = {b"IHDR", b"PLTE", b"IDAT", b"IEND", b"tRNS", b"gAMA", b"sRGB"}


@dataclass(frozen=True)
class Scrubber:
    """Removes secrets and paths."""

    secrets: tuple[str, ...]  # values replaced everywhere
    paths: tuple[tuple[str, str], ...]  # path prefixes and their replacements, longest first

    def remove_secrets(self, text: str) -> str:
        """``text`` without keys and home folders."""
        for secret in self.secrets:
            text = text.replace(secret, REMOVED)
        text = _KEYS.sub(REMOVED, text)
        for path, word in self.paths:
            text = re.sub(rf"{re.escape(path)}(?![\w.-])", lambda _, word=word: word, text)
        return _HOMES.sub("~", text)

    def describe_leak(self, data: bytes) -> str:
        """Kind of secret left in ``data``, without repeating it; empty if there is none."""
        text = data.decode("utf-8", "replace")
        if any(secret in text for secret in self.secrets) or _KEYS.search(text):
            return "a key"
        if _HOMES.search(text) or any(re.search(rf"{re.escape(path)}(?![\w.-])", text) for path, _ in self.paths):
            return "the path of a home folder"
        return ""


def make_scrubber(
    folder: Path,
    key_variables: Sequence[str] = (),
    environment: Mapping[str, str] = os.environ,
    home: Path | None = None,
) -> Scrubber:
    """The scrubber of a run.

    Args:
        folder: the run; its path becomes ``.``.
        key_variables: environment variables that hold keys according to the configuration.
        environment: the variables; names that suggest a key, token or password count too.
        home: the home folder, by default the user's; it becomes ``~``.
    """
    names = {*key_variables, *filter(_NAMES.search, environment)}
    values = {environment.get(name, "").strip() for name in names}
    secrets = {value for value in values if len(value) >= _SHORTEST and not Path(value).exists()}
    home = home or Path.home()
    words = {str(folder.resolve()): ".", str(home.resolve()): "~", str(home): "~"}
    words |= {_escape_for_json(path): word for path, word in words.items()}
    paths = sorted((path for path in words if len(path) > 1), key=len, reverse=True)
    secrets |= set(map(_escape_for_json, secrets))
    return Scrubber(tuple(sorted(secrets, key=len, reverse=True)), tuple((path, words[path]) for path in paths))


def _escape_for_json(text: str) -> str:
    return json.dumps(text)[1:-1]


def strip_png_metadata(data: bytes) -> bytes:
    """A PNG file without comments, places, cameras and dates. Raises ValueError: not a PNG file."""
    if not data.startswith(_PNG):
        raise ValueError("not a PNG file")
    chunks, start = [_PNG], len(_PNG)
    while start + 12 <= len(data):
        (length,) = struct.unpack(">I", data[start : start + 4])
        end = start + 12 + length
        if data[start + 4 : start + 8] in _PICTURE_CHUNKS:
            chunks.append(data[start:end])
        start = end
    return b"".join(chunks)


_TEXTS = frozenset({".json", ".jsonl", ".py", ".diff", ".urdf", ".xml", ".obj", ".mtl", ".md", ".txt", ".toml"})
_KINDS = _TEXTS | {".png", ".npz"}
"""Suffixes of files that can be searched."""
_MADE = frozenset({"trace.rrd", "report.html"})
"""Files made anew from the shared files."""
_STAMP = (1980, 1, 1, 0, 0, 0)


@dataclass(frozen=True)
class PackedRun:
    """A packed run."""

    path: Path
    files: int
    size: int  # of the zip file, bytes
    changed: tuple[str, ...]  # files with removed secrets
    left_out: tuple[str, ...]  # files that were not packed


def pack_run_as_zip(folder: Path, out: Path, scrubber: Scrubber, make: Callable[[Path], Sequence[Path]]) -> PackedRun:
    """Pack a run without secrets; ``make`` adds derived files to the cleaned copy.

    Raises:
        GrsError: a secret would remain.
    """
    changed: dict[str, bytes] = {}
    left_out: list[str] = []
    with tempfile.TemporaryDirectory() as temporary:
        copy = Path(temporary) / scrubber.remove_secrets(folder.resolve().name)
        for file in sorted(folder.rglob("*")):
            if not file.is_file() or file.is_symlink() or file.name in _MADE or file.suffix == ".zip":
                continue
            name = file.relative_to(folder)
            hidden = any(part.startswith(".") for part in name.parts) or escape_control_chars(str(name)) != str(name)
            before = read_bytes(file) if name.suffix in _KINDS and not hidden else None
            data = None if before is None else _clean_file_content(name, before, scrubber)
            if data is None:
                left_out.append(name.as_posix())
                continue
            if data != before:
                changed[name.as_posix()] = before or b""
            write_bytes(copy / name, data)
        update_hashes_in_copy(copy, changed, left_out)
        make(copy)
        packed = _zip_folder_without_leaks(copy, scrubber)
    try:
        write_file_or_stdout(out, packed.getvalue())
    except OSError as error:
        raise unwritable_error(out, error) from error
    with zipfile.ZipFile(packed) as archive:
        return PackedRun(out, len(archive.namelist()), len(packed.getvalue()), tuple(changed), tuple(left_out))


def _clean_file_content(name: Path, data: bytes, scrubber: Scrubber) -> bytes | None:
    """The cleaned content of a file; None if it cannot be searched."""
    if name.suffix in _TEXTS:
        return scrubber.remove_secrets(data.decode("utf-8", "replace")).encode()
    try:
        if name.suffix == ".png":
            return strip_png_metadata(data)
        return None if scrubber.describe_leak(" ".join(read_npz_strings(data, str(name))).encode()) else data
    except (ValueError, InputError):
        return None


def _zip_folder_without_leaks(copy: Path, scrubber: Scrubber) -> io.BytesIO:
    """Zip the folder after a second search of every member."""
    packed = io.BytesIO()
    with zipfile.ZipFile(packed, "w", zipfile.ZIP_DEFLATED) as archive:
        for file in sorted(copy.rglob("*")):
            if file.is_file():
                name, data = f"{copy.name}/{file.relative_to(copy).as_posix()}", file.read_bytes()
                for part in (data, name.encode()):
                    if leak := scrubber.describe_leak(part):
                        raise GrsError(f"not shared: {name} would hold {leak}", "report it, naming the file alone")
                member = zipfile.ZipInfo(name, _STAMP)
                member.compress_type = zipfile.ZIP_DEFLATED
                archive.writestr(member, data)
    packed.seek(0)
    return packed
