"""Content found by name: graphs, tools, prompts, assets and evals, one file for each thing a user may swap.
The content lies beside the package in a source tree and inside it (``_bundled``) in a wheel. A folder of the user's
own, laid over it with ``--content DIR``, wins where it has a file of the same name."""

import importlib.util
import sys
import threading
from pathlib import Path
from types import ModuleType
from typing import Literal

from grs_agents.errors import InputError, UnknownNameError

Kind = Literal["graphs", "tools", "prompts", "assets", "evals"]
KINDS: tuple[Kind, ...] = ("graphs", "tools", "prompts", "assets", "evals")
_SUFFIX: dict[Kind, str] = {"graphs": ".py", "tools": ".py", "prompts": ".md", "evals": ".py", "assets": ""}
_overlays: list[Path] = []
_loading = threading.RLock()
"""A module is registered before it is executed: another thread must not take it half-loaded."""


def package_root() -> Path:
    """The folder of the package itself."""
    return Path(__file__).parent


def content_root() -> Path:
    """The folder that holds the content folders shipped with GRS."""
    bundled = package_root() / "_bundled"
    return bundled if bundled.is_dir() else package_root().parent


def add_overlay_folder(folder: Path) -> None:
    """Lay ``folder`` (with any of graphs/, tools/, prompts/, assets/, evals/) over the shipped content.
    Its Python files are executed when they are used, hence never added by default.
    Raises InputError: the folder does not exist."""
    if folder in _overlays:
        return
    if not folder.is_dir():
        raise InputError(f"content folder {folder} does not exist", "name an existing folder with --content")
    resolved = folder.resolve()
    if resolved not in _overlays:
        _overlays.insert(0, resolved)


def content_search_roots() -> list[Path]:
    """The content roots, first match wins."""
    return [*_overlays, content_root()]


def content_names(kind: Kind) -> list[str]:
    """Every name of ``kind``, sorted. Names that start with an underscore are private."""
    entries: set[str] = set()
    for root in content_search_roots():
        for entry in (root / kind).glob(f"*{_SUFFIX[kind]}") if (root / kind).is_dir() else ():
            if not entry.name.startswith(("_", ".")):
                entries.add(entry.stem if _SUFFIX[kind] else entry.name)
    return sorted(entries)


def content_path(kind: Kind, name: str) -> Path:
    """The file (or, for assets, the file or folder) called ``name``. Raises UnknownNameError: nothing has that name."""
    return all_content_paths(kind, name)[0]


def all_content_paths(kind: Kind, name: str) -> list[Path]:
    """Every file or folder called ``name``, the one that wins first. Raises UnknownNameError: nothing has that name."""
    public = name != "" and name == Path(name).name and not name.startswith(("_", "."))
    candidates = [root / kind / f"{name}{_SUFFIX[kind]}" for root in content_search_roots()] if public else []
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


def load_module(kind: Kind, name: str) -> ModuleType:
    """Import the content file ``name`` once. Raises UnknownNameError: nothing has that name."""
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
        except BaseException:
            del sys.modules[qualified]
            raise
        return module
