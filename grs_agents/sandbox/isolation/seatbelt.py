"""The command line of macOS's ``sandbox-exec``, and the profile that it keeps."""

import shutil
import sys
from collections.abc import Iterable, Sequence
from pathlib import Path

from grs_agents.sandbox.isolation import allowlist


def wrap(readable: Sequence[Path], scratch: Path) -> list[str]:
    """What to put before a command.

    Args:
        readable: files and folders that can be read beside the system's own.
        scratch: the only folder that can be written.
    """
    return [shutil.which("sandbox-exec") or "sandbox-exec", "-p", profile(readable, scratch)]


def profile(readable: Sequence[Path], scratch: Path) -> str:
    """Nothing but reading what is named, writing ``scratch`` and signalling oneself; no network, no other process.

    The rules that a program needs to start at all are Apple's own, which change with the system. ``sandbox-exec``
    starts the interpreter within the profile, so the interpreter alone may be executed, in place of itself.
    """
    paths = (*allowlist.system_paths(), *readable)
    parents = sorted({parent for path in (*paths, scratch) for parent in path.parents})
    lines = [
        "(version 1)",
        "(deny default)",
        '(import "system.sb")',
        "(deny network*)",
        "(deny process-fork)",
        f"(allow process-exec {_each('literal', _interpreters())})",
        f"(allow file-read-metadata {_each('literal', parents)})",
        f"(allow file-read* file-map-executable {_each('subpath', paths)})",
        f"(allow file-read* file-write* {_each('subpath', [scratch])})",
        '(allow file-read* file-write-data (literal "/dev/null"))',
        "(allow signal (target self))",
        "(allow sysctl-read)",
    ]
    return "\n".join(lines)


def _interpreters() -> list[Path]:
    """This interpreter under each of its names; macOS's own starts another program of the same installation."""
    inner = Path(sys.base_prefix, "Resources", "Python.app", "Contents", "MacOS", "Python")
    named = [Path(sys.executable), Path(sys.executable).resolve(), inner, inner.resolve()]
    return sorted({path for path in named if path.exists()})


def _each(kind: str, paths: Iterable[Path]) -> str:
    return " ".join(f"({kind} {_quoted(path)})" for path in paths)


def _quoted(path: Path) -> str:
    return '"' + str(path).replace("\\", "\\\\").replace('"', '\\"') + '"'
