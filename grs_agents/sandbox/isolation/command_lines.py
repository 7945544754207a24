"""The command lines that confine a process from outside: bubblewrap on Linux, ``sandbox-exec`` on macOS."""

import shutil
import sys
from collections.abc import Iterable, Sequence
from pathlib import Path

from grs_agents.sandbox.isolation import allowlist


def bubblewrap_command_prefix(
    readable: Sequence[Path], scratch: Sequence[Path], scratch_bytes: int, writable: Sequence[Path] = ()
) -> list[str]:
    """Prefix of a command for its own name spaces and a file system of the named paths. ``readable`` is visible
    read-only, beside the system's own files; each folder of ``scratch`` is a writable file system of ``scratch_bytes``
    bytes; the folders ``writable`` are those of the host."""
    command = [shutil.which("bwrap") or "bwrap", "--unshare-all", "--unshare-user", "--cap-drop", "ALL"]
    command += ["--hostname", "sandbox"]
    for path in allowlist.system_paths():
        command += ["--symlink", str(path.readlink()), str(path)] if path.is_symlink() else _read_only_bind_args(path)
    for path in readable:
        command += _read_only_bind_args(path)
    command += ["--proc", "/proc", "--dev", "/dev"]
    for folder in scratch:
        command += ["--size", str(scratch_bytes), "--tmpfs", str(folder)]
    for folder in writable:
        command += ["--bind", str(folder), str(folder)]
    return [*command, "--remount-ro", "/", "--remount-ro", "/dev", "--chdir", "/"]


def _read_only_bind_args(path: Path) -> list[str]:
    return ["--ro-bind", str(path), str(path)]


def seatbelt_command_prefix(readable: Sequence[Path], scratch: Path, writable: Sequence[Path] = ()) -> list[str]:
    """Prefix of a command on macOS; arguments as of ``seatbelt_profile``."""
    return [shutil.which("sandbox-exec") or "sandbox-exec", "-p", seatbelt_profile(readable, scratch, writable)]


def seatbelt_profile(readable: Sequence[Path], scratch: Path, writable: Sequence[Path] = ()) -> str:
    """The rules of macOS's ``sandbox-exec``: no network, no other process, only the named files.

    The rules that a program needs to start at all are Apple's own, which change with the system. ``sandbox-exec``
    starts the interpreter within the profile, so the interpreter alone may be executed, in place of itself.
    ``scratch`` and the folders ``writable`` are all that can be written.
    """
    paths = (*allowlist.system_paths(), *readable)
    parents = sorted({parent for path in (*paths, scratch, *writable) for parent in path.parents})
    inner = Path(sys.base_prefix, "Resources", "Python.app", "Contents", "MacOS", "Python")
    named = [Path(sys.executable), Path(sys.executable).resolve(), inner, inner.resolve()]
    lines = [
        "(version 1)",
        "(deny default)",
        '(import "system.sb")',
        "(deny network*)",
        "(deny process-fork)",
        f"(allow process-exec {_format_path_filters('literal', sorted({path for path in named if path.exists()}))})",
        f"(allow file-read-metadata {_format_path_filters('literal', parents)})",
        f"(allow file-read* file-map-executable {_format_path_filters('subpath', paths)})",
        f"(allow file-read* file-write* {_format_path_filters('subpath', [scratch, *writable])})",
        '(allow file-read* file-write-data (literal "/dev/null"))',
        "(allow signal (target self))",
        "(allow sysctl-read)",
    ]
    return "\n".join(lines)


def _format_path_filters(kind: str, paths: Iterable[Path]) -> str:
    quoted = (str(path).replace("\\", "\\\\").replace('"', '\\"') for path in paths)
    return " ".join(f'({kind} "{path}")' for path in quoted)
