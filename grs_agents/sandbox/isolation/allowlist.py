"""The files a worker may read: the system's libraries, this interpreter, this package and its content."""

import sys
from collections.abc import Iterable
from functools import cache
from pathlib import Path

from grs_agents.base import content

_PROGRAMS = ("/usr", "/lib", "/lib32", "/lib64", "/bin", "/sbin")
_PROGRAMS_OF_MACOS = ("/System/Library", "/Library/Frameworks", "/opt/homebrew/opt", "/opt/homebrew/Cellar")
_SETTINGS = ("/etc/ld.so.cache", "/etc/localtime", "/etc/alternatives")
_DEVICES = ("/dev/zero", "/dev/urandom", "/dev/random")
_FACTS = ("/proc/cpuinfo", "/proc/meminfo", "/proc/stat", "/sys/devices/system/cpu")
_CONTENT = ("tools", "assets")
_PACKAGES = ("site-packages", "dist-packages")


@cache
def system_paths() -> tuple[Path, ...]:
    """Paths that every dynamically linked program reads."""
    programs = (*_PROGRAMS, *_PROGRAMS_OF_MACOS) if sys.platform == "darwin" else _PROGRAMS
    return tuple(path for path in map(Path, (*programs, *_SETTINGS)) if path.exists())


@cache
def kernel_paths() -> tuple[Path, ...]:
    """Devices and files of the kernel that numeric libraries look at."""
    return tuple(path for path in map(Path, (*_DEVICES, *_FACTS)) if path.exists())


def runtime_paths() -> tuple[Path, ...]:
    """The interpreter, installed packages, this package, and the content that workers load. The folder that *holds* the
    package is not among them: in a source tree it is a repository with whatever lies in it."""
    packages = [Path(entry) for entry in sys.path if Path(entry).name in _PACKAGES]
    package = content.package_root()
    roots = content.content_search_roots()
    paths = [Path(sys.prefix), Path(sys.base_prefix), *packages, package, *content_paths(roots)]
    return outermost_paths(path for path in paths if path.exists() and path not in (Path("/"), Path.home()))


def content_paths(roots: Iterable[Path]) -> tuple[Path, ...]:
    """The folders below each content root that workers load from, and nothing beside them."""
    return tuple(root / kind for root in roots for kind in _CONTENT if (root / kind).is_dir())


def content_overlays() -> list[Path]:
    """Content folders of the user that workers load from, the topmost last."""
    return [root for root in reversed(content.content_search_roots()[:-1]) if content_paths([root])]


def outermost_paths(paths: Iterable[Path]) -> tuple[Path, ...]:
    """The outermost of ``paths``, absolute and with links resolved; without those inside another or a system path."""
    named = [path.absolute() for path in paths]
    every = sorted({path for path in named if ".." not in path.parts} | {path.resolve() for path in named})
    kept: list[Path] = list(system_paths())
    for path in every:
        if not is_path_covered(path, kept):
            kept.append(path)
    return tuple(kept[len(system_paths()) :])


def is_path_covered(path: Path, allowed: Iterable[Path]) -> bool:
    """True if ``path`` equals a path of ``allowed`` or lies inside it."""
    return any(path == root or root in path.parents for root in allowed)
