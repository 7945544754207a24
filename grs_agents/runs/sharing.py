"""A run as one zip file for anybody to replay, without keys and without paths that tell whose machine it is."""

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

from grs_agents.base.errors import GrsError, InputError
from grs_agents.base.files import unwritable_error, write_bytes, write_file_or_stdout
from grs_agents.base.foreign.arrays import read_npz_strings
from grs_agents.base.foreign.files import read_bytes
from grs_agents.base.terminal.control_characters import escape_control_chars
from grs_agents.runs.hashes import update_hashes_in_copy

REMOVED = "[removed]"
_NAMES = re.compile(r"KEY|TOKEN|SECRET|PASSW|CREDENTIAL", re.IGNORECASE)
_SHORTEST = 8
"""Characters; a shorter value of a variable is taken for no key, since it would be found in any text."""
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
    """Replaces what must not leave."""

    secrets: tuple[str, ...]  # values that are replaced wherever they are
    paths: tuple[tuple[str, str], ...]  # prefixes of paths and what replaces each, longest first

    def remove_secrets(self, text: str) -> str:
        """``text`` without keys and home folders."""
        for secret in self.secrets:
            text = text.replace(secret, REMOVED)
        text = _KEYS.sub(REMOVED, text)
        for path, word in self.paths:
            text = re.sub(rf"{re.escape(path)}(?![\w.-])", lambda _, word=word: word, text)
        return _HOMES.sub("~", text)

    def describe_leak(self, data: bytes) -> str:
        """What is still in ``data`` that must not leave, in words that do not repeat it; empty if nothing is."""
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
    """The scrubber for a run.

    Args:
        folder: the run; its own path becomes ``.``.
        key_variables: environment variables that the configuration names as holding keys.
        environment: where their values are, and those of every variable that is called a key, token or password.
        home: the home folder, that of the user by default; it becomes ``~``.
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
    """A PNG file without all that is no picture: comments, places, cameras, dates; ``ValueError`` if it is none."""
    if not data.startswith(_PNG):
        raise ValueError("not a PNG file")
    kept, at = [_PNG], len(_PNG)
    while at + 12 <= len(data):
        (length,) = struct.unpack(">I", data[at : at + 4])
        end = at + 12 + length
        if data[at + 4 : at + 8] in _PICTURE_CHUNKS:
            kept.append(data[at:end])
        at = end
    return b"".join(kept)


_TEXTS = frozenset({".json", ".jsonl", ".py", ".diff", ".urdf", ".xml", ".obj", ".mtl", ".md", ".txt", ".toml"})
_KINDS = _TEXTS | {".png", ".npz"}
"""What can be looked through."""
_MADE = frozenset({"trace.rrd", "report.html"})
"""Made anew from what is shared."""
_STAMP = (1980, 1, 1, 0, 0, 0)


@dataclass(frozen=True)
class PackedRun:
    """What was packed."""

    path: Path
    files: int
    size: int  # of the zip file, bytes
    changed: tuple[str, ...]  # files from which something was removed
    left_out: tuple[str, ...]  # files that were not packed


def pack_run_as_zip(folder: Path, out: Path, scrubber: Scrubber, make: Callable[[Path], Sequence[Path]]) -> PackedRun:
    """Pack a run."""
    changed: dict[str, bytes] = {}
    left_out: list[str] = []
    with tempfile.TemporaryDirectory() as temporary:
        copy = Path(temporary) / scrubber.remove_secrets(folder.resolve().name)
        for name in _list_run_files(folder):
            before = read_bytes(folder / name) if _is_scannable_file(name) else None
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


def _list_run_files(folder: Path) -> list[Path]:
    """The files of a run, relative to its folder, without what is made anew, links and earlier zip files."""
    files = (file for file in sorted(folder.rglob("*")) if file.is_file() and not file.is_symlink())
    return [file.relative_to(folder) for file in files if file.name not in _MADE and file.suffix != ".zip"]


def _is_scannable_file(name: Path) -> bool:
    """Whether a file is of a kind that can be looked through, under a name that hides nothing."""
    hidden = any(part.startswith(".") for part in name.parts) or escape_control_chars(str(name)) != str(name)
    return not hidden and name.suffix in _KINDS


def _clean_file_content(name: Path, data: bytes, scrubber: Scrubber) -> bytes | None:
    """The content to share of a file; None if it is of a kind that cannot be looked through."""
    if name.suffix in _TEXTS:
        return scrubber.remove_secrets(data.decode("utf-8", "replace")).encode()
    try:
        if name.suffix == ".png":
            return strip_png_metadata(data)
        return None if scrubber.describe_leak(" ".join(read_npz_strings(data, str(name))).encode()) else data
    except (ValueError, InputError):
        return None


def _zip_folder_without_leaks(copy: Path, scrubber: Scrubber) -> io.BytesIO:
    """The folder as a zip file whose every member was searched once more."""
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
