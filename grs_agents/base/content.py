"""Content found by name: graphs, tools, prompts, assets and evals, each exchangeable part a file. The content lies
beside the package in a source tree and inside it (``_bundled``) in a wheel. A folder of the user, laid over it with
``--content DIR``, wins for files of the same name. An installed package adds content by an entry point of the group
``grs_agents.content``; shipped files of the same name win over it."""

import hashlib
import importlib.util
import sys
import sysconfig
import threading
import traceback
from collections.abc import Callable
from functools import cache
from importlib.metadata import entry_points
from pathlib import Path
from types import ModuleType
from typing import Any, Literal

from grs_agents.base.errors import ConfigError, GrsError, InputError, UnknownNameError

Kind = Literal["graphs", "tools", "prompts", "assets", "evals", "policies", "models"]
KINDS: tuple[Kind, ...] = ("graphs", "tools", "prompts", "assets", "evals")
"""The kinds that GRS ships; its policies and models are no files of content."""
ENTRY_POINTS = "grs_agents.content"
"""The group of entry points that name packages whose folders hold content."""
_SUFFIX: dict[Kind, str] = {"prompts": ".md", "assets": ""}
_LONGEST_MESSAGE = 400
"""Characters of another's exception that a message repeats."""
_overlays: list[Path] = []
_loading = threading.RLock()
"""A module is registered before it is executed: another thread must not take it half-loaded."""


def package_root() -> Path:
    """The folder of the package itself."""
    return Path(__file__).parent.parent


def content_root() -> Path:
    """The folder that holds the content folders shipped with GRS."""
    bundled = package_root() / "_bundled"
    return bundled if bundled.is_dir() else package_root().parent


def add_overlay_folder(folder: Path) -> None:
    """Lay ``folder`` (with any of graphs/, tools/, prompts/, assets/, evals/, policies/, models/) over the shipped
    content. Its Python files are executed when they are used, hence never added by default. Raises InputError: the
    folder does not exist."""
    if folder in _overlays:
        return
    if not folder.is_dir():
        raise InputError(f"content folder {folder} does not exist", "name an existing folder with --content")
    resolved = folder.resolve()
    if resolved not in _overlays:
        _overlays.insert(0, resolved)


def list_content_options() -> list[str]:
    """Options by which a command line finds the same content as this process."""
    return [part for folder in _overlays[:1] for part in ("--content", str(folder))]


def content_search_roots() -> list[Path]:
    """The content roots, first match wins."""
    return [*_overlays, content_root(), *installed_content_folders()]


@cache
def installed_content_folders() -> tuple[Path, ...]:
    """The folders of the packages that entry points name. Raises InputError: there is no such package."""
    folders: list[Path] = []
    for entry in entry_points(group=ENTRY_POINTS):
        try:
            spec = importlib.util.find_spec(entry.value)
        except ImportError:
            spec = None
        if spec is None or not spec.submodule_search_locations:
            what = f"entry point {entry.name!r} of {ENTRY_POINTS} names no package: {entry.value}"
            raise InputError(what, "mend or uninstall the package that has it")
        folders += [Path(folder).resolve() for folder in spec.submodule_search_locations]
    return tuple(folders)


def content_names(kind: Kind) -> list[str]:
    """Every name of ``kind``, sorted. Names that start with an underscore are private."""
    entries: set[str] = set()
    for root in content_search_roots():
        for entry in (root / kind).glob(f"*{_suffix_of_kind(kind)}") if (root / kind).is_dir() else ():
            if not entry.name.startswith(("_", ".")):
                entries.add(entry.stem if _suffix_of_kind(kind) else entry.name)
    return sorted(entries)


def _suffix_of_kind(kind: Kind) -> str:
    return _SUFFIX.get(kind, ".py")


def content_path(kind: Kind, name: str) -> Path:
    """The file (or, for assets, the file or folder) called ``name``. Raises UnknownNameError: nothing has that name."""
    return all_content_paths(kind, name)[0]


def all_content_paths(kind: Kind, name: str) -> list[Path]:
    """Every file or folder called ``name``, the winner first. Raises UnknownNameError: nothing has that name."""
    public = name != "" and name == Path(name).name and not name.startswith(("_", "."))
    candidates = [root / kind / f"{name}{_suffix_of_kind(kind)}" for root in content_search_roots()] if public else []
    existing = [candidate for candidate in candidates if candidate.exists()]
    if not existing:
        raise UnknownNameError(kind.removesuffix("s"), name, content_names(kind))
    return existing


def sample_scenes() -> dict[str, Path]:
    """The folders of the sample scenes by name, first match wins."""
    return {entry.name: entry for entry in _list_sample_entries("scenes") if entry.is_dir()}


def shipped_cassettes() -> dict[str, Path]:
    """The files of the recorded runs by name, first match wins."""
    return {entry.stem: entry for entry in _list_sample_entries("cassettes") if entry.suffix == ".json"}


def _list_sample_entries(kind: str) -> list[Path]:
    folders = [root / "assets" / kind for root in reversed(content_search_roots())]
    return [entry for folder in folders if folder.is_dir() for entry in sorted(folder.iterdir())]


def find_class(kind: Kind, name: str, attribute: str) -> Callable[..., Any] | None:
    """The class ``attribute`` of the content file ``name``; None if there is no such file.
    Raises InputError: the file has no such class."""
    if name not in content_names(kind):
        return None
    module = load_module(kind, name)
    loaded = getattr(module, attribute, None)
    if not callable(loaded):
        raise InputError(f"{module.__file__} has no class {attribute}", f"call the class {attribute}")
    return loaded


def load_module(kind: Kind, name: str) -> ModuleType:
    """Import the content file ``name`` once.
    Raises UnknownNameError: nothing has that name. ConfigError: it cannot be imported; the message names file and line.
    """
    file, qualified = content_path(kind, name), f"grs_content.{kind}.{name}"
    with _loading:
        loaded = sys.modules.get(qualified)
        if loaded is not None and loaded.__file__ == str(file):
            return loaded
        spec = importlib.util.spec_from_file_location(qualified, file)
        if spec is None or spec.loader is None:
            raise InputError(f"{file} is not a Python file", "name a .py file")
        module = importlib.util.module_from_spec(spec)
        sys.modules[qualified] = module  # before exec: dataclasses and pydantic look their module up by name
        try:
            spec.loader.exec_module(module)
        except BaseException as error:
            del sys.modules[qualified]
            if isinstance(error, GrsError) or not isinstance(error, Exception | SystemExit):
                raise
            fault = f"{locate_user_code(error) or file}: {describe_exception(error)}"
            raise ConfigError(
                f"{kind.removesuffix('s')} {name!r} cannot be imported: {fault}", "mend the file"
            ) from error
        return module


def is_shipped(file: Path) -> bool:
    """True if ``file`` belongs to the package or its content."""
    return any(file.is_relative_to(root) for root in (package_root(), *(content_root() / kind for kind in KINDS)))


def list_frames(error: BaseException, since: str | None = None) -> list[traceback.FrameSummary]:
    """The frames of an exception's traceback, outermost first, from after the last frame of the file ``since``."""
    frames = list(traceback.extract_tb(error.__traceback__))
    last = max((number for number, frame in enumerate(frames) if frame.filename == since), default=-1)
    return frames if since is None else frames[last + 1 :] if last >= 0 else []


def locate_user_code(error: BaseException, since: str | None = None) -> str:
    """``FILE:LINE`` of the innermost frame of the user's code in an exception's traceback; empty without such a frame.

    All code is the user's except GRS, Python and installed packages without content of GRS.
    """
    places = [(frame.filename, frame.lineno) for frame in list_frames(error, since)]
    if isinstance(error, SyntaxError) and error.filename:
        places.append((error.filename, error.lineno))
    for name, line in reversed(places):
        file = Path(name)
        if not file.is_file() or is_shipped(file):
            continue
        is_content = any(file.is_relative_to(root) for root in (*_overlays, *installed_content_folders()))
        installed = (sysconfig.get_path(kind) for kind in ("stdlib", "purelib", "platlib"))
        if is_content or not any(file.is_relative_to(folder) for folder in installed):
            return f"{name}:{line}"
    return ""


def describe_exception(error: BaseException) -> str:
    """The kind of an exception and its message, in a single line."""
    text = " ".join(str(error.msg if isinstance(error, SyntaxError) else error).split())
    return f"{type(error).__name__}: {text[:_LONGEST_MESSAGE]}" if text else type(error).__name__


def hash_files(*places: Path) -> str:
    """A hash of all files in these folders, which ties figures to the code that produced them."""
    files = sorted(file for place in places for file in (place.rglob("*") if place.is_dir() else [place]))
    whole = hashlib.sha256()
    for file in files:
        if file.is_file() and "__pycache__" not in file.parts:
            whole.update(file.name.encode() + b"\0" + file.read_bytes())
    return whole.hexdigest()


def hash_code() -> str:
    """A hash of the package and of all content, overlays included, without the evals' results."""
    content = [path for root in content_search_roots() for kind in KINDS for path in (root / kind).glob("*")]
    return hash_files(package_root(), *(path for path in content if path.name != "results"))
