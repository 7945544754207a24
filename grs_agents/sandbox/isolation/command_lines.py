"""The command lines that confine a process from outside: bubblewrap on Linux, ``sandbox-exec`` on macOS."""

import shutil
import sys
from collections.abc import Iterable, Sequence
from pathlib import Path

from grs_agents.sandbox.isolation import allowlist


def bubblewrap_command_prefix(
    readable: Sequence[Path], scratch: Sequence[Path], scratch_bytes: int, writable: Sequence[Path] = ()
) -> list[str]:
    """What to put before a command, for name spaces of its own and a file system of what is named.
    ``readable`` is visible read-only, beside the system's own files; each folder of ``scratch`` is a writable file
    system of ``scratch_bytes`` bytes; the folders ``writable`` are those of the host."""
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
    """What to put before a command on macOS; the arguments are those of ``seatbelt_profile``."""
    return [shutil.which("sandbox-exec") or "sandbox-exec", "-p", seatbelt_profile(readable, scratch, writable)]


def seatbelt_profile(readable: Sequence[Path], scratch: Path, writable: Sequence[Path] = ()) -> str:
    """The rules of macOS's ``sandbox-exec``: no network, no other process, no file but what is named.

    The rules that a program needs to start at all are Apple's own, which change with the system. ``sandbox-exec``
    starts the interpreter within the profile, so the interpreter alone may be executed, in place of itself.
    ``scratch`` and the folders ``writable`` are all that can be written.
    """
    paths = (*allowlist.system_paths(), *readable)
    parents = sorted({parent for path in (*paths, scratch, *writable) for parent in path.parents})
    lines = [
        "(version 1)",
        "(deny default)",
        '(import "system.sb")',
        "(deny network*)",
        "(deny process-fork)",
        f"(allow process-exec {_format_path_filters('literal', _interpreter_paths())})",
        f"(allow file-read-metadata {_format_path_filters('literal', parents)})",
        f"(allow file-read* file-map-executable {_format_path_filters('subpath', paths)})",
        f"(allow file-read* file-write* {_format_path_filters('subpath', [scratch, *writable])})",
        '(allow file-read* file-write-data (literal "/dev/null"))',
        "(allow signal (target self))",
        "(allow sysctl-read)",
    ]
    return "\n".join(lines)


def _interpreter_paths() -> list[Path]:
    """This interpreter under each of its names; macOS's own starts another program of the same installation."""
    inner = Path(sys.base_prefix, "Resources", "Python.app", "Contents", "MacOS", "Python")
    named = [Path(sys.executable), Path(sys.executable).resolve(), inner, inner.resolve()]
    return sorted({path for path in named if path.exists()})


def _format_path_filters(kind: str, paths: Iterable[Path]) -> str:
    return " ".join(f"({kind} {_quote_path(path)})" for path in paths)


def _quote_path(path: Path) -> str:
    return '"' + str(path).replace("\\", "\\\\").replace('"', '\\"') + '"'
