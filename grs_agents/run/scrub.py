"""What must not leave this machine with a run: keys, and paths that tell whose machine it is."""

import json
import os
import re
import struct
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

REMOVED = "[removed]"
_NAMES = re.compile(r"KEY|TOKEN|SECRET|PASSW|CREDENTIAL", re.IGNORECASE)
_SHORTEST = 8
"""Characters; a shorter value of a variable is taken for no key, since it would be found in any text."""
_KEYS = re.compile(
    r"\b(?:sk|pk|rk)-[A-Za-z0-9_\-]{16,}"
    r"|\bAIza[A-Za-z0-9_\-]{30,}"
    r"|\b(?:gh[pousr]|github_pat|hf|glpat|xox[abprs]|lsv2|ls__)[_\-][A-Za-z0-9_\-]{16,}"
    r"|\bAKIA[A-Z0-9]{16}\b"
    r"|\beyJ[A-Za-z0-9_\-]{8,}\.[A-Za-z0-9_\-]{8,}\.[A-Za-z0-9_\-]{8,}"
    r"|(?<=Bearer )[A-Za-z0-9._~+/\-]{16,}=*"
    r"|(?<=://)[^/\s:@\"']{1,200}:[^/\s@\"']{1,200}(?=@)"
    r"|-----BEGIN [A-Z ]*PRIVATE KEY-----.*?-----END [A-Z ]*PRIVATE KEY-----",
    re.DOTALL,
)
_HOMES = re.compile(r"(?:/home/|/Users/|[A-Za-z]:(?:\\{1,2}|/)Users(?:\\{1,2}|/))[^/\\\s\"'<>:,;)\]}]+")
_PNG = b"\x89PNG\r\n\x1a\n"
_PICTURE_CHUNKS = {b"IHDR", b"PLTE", b"IDAT", b"IEND", b"tRNS", b"gAMA", b"sRGB"}


@dataclass(frozen=True)
class Scrubber:
    """Replaces what must not leave.

    Attributes:
        secrets: values that are replaced wherever they are.
        paths: prefixes of paths and what stands for each, longest first.
    """

    secrets: tuple[str, ...]
    paths: tuple[tuple[str, str], ...]

    def clean(self, text: str) -> str:
        """``text`` without keys and home folders."""
        for secret in self.secrets:
            text = text.replace(secret, REMOVED)
        text = _KEYS.sub(REMOVED, text)
        for path, stand_in in self.paths:
            text = re.sub(rf"{re.escape(path)}(?![\w.-])", lambda _, word=stand_in: word, text)
        return _HOMES.sub("~", text)

    def leaks(self, data: bytes) -> str:
        """What is still in ``data`` that must not leave, in words that do not repeat it; empty if nothing is."""
        text = data.decode("utf-8", "replace")
        if any(secret in text for secret in self.secrets) or _KEYS.search(text):
            return "a key"
        if _HOMES.search(text) or any(re.search(rf"{re.escape(path)}(?![\w.-])", text) for path, _ in self.paths):
            return "the path of a home folder"
        return ""


def scrubber(
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
    names = {*key_variables, *(name for name in environment if _NAMES.search(name))}
    values = {environment.get(name, "").strip() for name in names}
    secrets = {value for value in values if len(value) >= _SHORTEST and not Path(value).exists()}
    known = {str(folder.resolve()): ".", str((home or Path.home()).resolve()): "~", str(home or Path.home()): "~"}
    spelt = {**known, **{json.dumps(path)[1:-1]: word for path, word in known.items()}}
    paths = sorted(((path, word) for path, word in spelt.items() if len(path) > 1), key=lambda one: -len(one[0]))
    spoken = secrets | {json.dumps(value)[1:-1] for value in secrets}
    return Scrubber(tuple(sorted(spoken, key=len, reverse=True)), tuple(paths))


def picture_alone(data: bytes) -> bytes:
    """A PNG file without all that is no picture: comments, places, cameras, dates.

    Raises:
        ValueError: it is no PNG file.
    """
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
