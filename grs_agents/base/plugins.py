"""User-defined classes, found by dotted path or entry point."""

import sys
from collections.abc import Callable, Iterable
from importlib import import_module
from importlib.metadata import entry_points
from pathlib import Path
from typing import Any

from grs_agents.base.errors import ConfigError, UnknownNameError


def load_named_class(kind: str, name: str, group: str, builtin: Iterable[str]) -> Callable[..., Any]:
    """Load ``package.module:Class`` or the entry point ``name`` of ``group``; it is not called yet.

    The module may lie in the current folder, which is appended to Python's path.

    Args:
        kind: of class, for messages: ``policy``, ``model``.
        name: the dotted path, or the entry point's name.
        group: the group of entry points.
        builtin: the other names that are valid, for messages.

    Raises:
        UnknownNameError: nothing has that name.
        ConfigError: its module cannot be imported, or has no such class.
    """
    entries = entry_points(group=group)
    module, colon, attribute = name.partition(":")
    known = [*builtin, *entries.names, "package.module:Class"]
    if name not in entries.names and not (module and colon):
        raise UnknownNameError(kind, name, known)
    folder = str(Path.cwd())
    if folder not in sys.path:
        sys.path.append(folder)
    try:
        loaded = entries[name].load() if name in entries.names else getattr(import_module(module), attribute)
    except Exception as error:  # of the user's code
        if isinstance(error, ModuleNotFoundError) and error.name == module.partition(".")[0]:
            why = f": there is no module {error.name!r} in Python's path or in the current folder"
            raise UnknownNameError(kind, name, known, why) from error
        raise broken_class_error(kind, name, error) from error
    if not callable(loaded):
        raise ConfigError(f"{kind} {name!r} is no class", "give package.module:Class")
    return loaded


def broken_class_error(kind: str, name: str, error: Exception) -> ConfigError:
    """The error for a user-defined class that cannot be imported or made."""
    what = f"{kind} {name!r}: {type(error).__name__}: {error}"
    return ConfigError(what, "give package.module:Class of an importable class, and the arguments that it needs")
