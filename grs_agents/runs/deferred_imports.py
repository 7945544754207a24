"""Deferred imports of LangSmith and of LangGraph's server client, which LangGraph imports even if unused.

They take a quarter of the CPU time that ``grs run`` needs to start. The command line imports them on first use.
With any ``LANGSMITH_`` or ``LANGCHAIN_`` variable, LangSmith is imported at once.
"""

import importlib
import os
import sys
from importlib.util import find_spec, module_from_spec
from threading import RLock
from types import ModuleType
from typing import Any, Final

_UNTRACED: Final = dict.fromkeys(
    ("parent", "project_name", "address", "tags", "metadata", "enabled", "client", "replicas", "distributed_parent_id")
)
"""LangSmith's context without tracing."""
_LOCK: Final = RLock()


def defer_unused_imports() -> None:
    """Defer the imports of LangSmith and of LangGraph's server client. Call it before LangGraph is imported."""
    _defer("langgraph_sdk")
    if _is_tracing_configured():
        return
    _defer(
        "langsmith",
        get_tracing_context=_get_tracing_context,
        Client=_DeferredClass("client", "Client"),
        RunTree=_DeferredClass("run_trees", "RunTree"),
    )
    _defer("langsmith.address")
    _defer("langsmith.run_trees")
    _defer("langsmith.utils", tracing_is_enabled=_tracing_is_enabled)
    _defer("langsmith.run_helpers", get_tracing_context=_get_tracing_context, _set_tracing_context=_set_tracing_context)


def _defer(name: str, **known: Any) -> None:
    """Execute the module ``name`` on first access of a name that is not in ``known``."""
    spec = None if name in sys.modules else find_spec(name)
    if spec is None or spec.loader is None:
        return
    module = module_from_spec(spec)
    module.__class__ = _UnexecutedModule
    vars(module).update(known)
    sys.modules[name] = module
    _closed.add(name)
    package, _, child = name.rpartition(".")
    if package:
        setattr(sys.modules[package], child, module)


class _UnexecutedModule(ModuleType):
    """A module that is executed on first access of a missing name."""

    def __getattr__(self, name: str) -> Any:
        with _LOCK:
            # The import system reads __path__ of every module.
            if name == "__path__" or self.__name__ in _opening:
                raise AttributeError(f"module {self.__name__!r} has no attribute {name!r} yet")
            _execute_deferred_module(self)
        return getattr(self, name)


_closed: set[str] = set()
_opening: set[str] = set()


def _execute_deferred_module(module: Any) -> None:
    """Execute a module unless that has been done."""
    name: str = module.__name__
    with _LOCK:
        if name not in _closed:
            return
        _opening.add(name)
        try:
            module.__spec__.loader.exec_module(module)
            module.__class__ = ModuleType
            _closed.remove(name)
        finally:
            _opening.remove(name)


class _DeferredClass:
    """Placeholder for a LangSmith class, mostly met in annotations; the class is imported on first use."""

    def __init__(self, module: str, name: str) -> None:
        self._place = (f"langsmith.{module}", name)

    def _import_deferred_class(self) -> Any:
        module, name = self._place
        return getattr(importlib.import_module(module), name)

    def __call__(self, *arguments: Any, **options: Any) -> Any:
        return self._import_deferred_class()(*arguments, **options)

    def __instancecheck__(self, instance: object) -> bool:
        return isinstance(instance, self._import_deferred_class())

    def __mro_entries__(self, bases: tuple[Any, ...]) -> tuple[Any, ...]:
        return (self._import_deferred_class(),)

    def __getattr__(self, name: str) -> Any:
        return getattr(self._import_deferred_class(), name)

    def model_dump(self, *arguments: Any, **options: Any) -> Any:
        """As the class's method; LangChain reads that of ``RunTree`` at import."""
        return self._import_deferred_class().model_dump(*arguments, **options)


def _is_tracing_configured() -> bool:
    return any(name.startswith(("LANGSMITH_", "LANGCHAIN_")) for name in os.environ)


def _load_langsmith_if_tracing(module: str) -> Any:
    """The module of LangSmith if it is in use, else None."""
    deferred = sys.modules[f"langsmith.{module}"]
    if deferred.__name__ in _closed and not _is_tracing_configured():
        return None
    _execute_deferred_module(deferred)
    return deferred


def _get_tracing_context(*arguments: Any) -> Any:
    helpers = _load_langsmith_if_tracing("run_helpers")
    return helpers.get_tracing_context(*arguments) if helpers else dict(_UNTRACED)


def _set_tracing_context(context: dict[str, Any]) -> None:
    if helpers := _load_langsmith_if_tracing("run_helpers"):
        vars(helpers)["_set_tracing_context"](context)


def _tracing_is_enabled(*arguments: Any) -> Any:
    utils = _load_langsmith_if_tracing("utils")
    return bool(utils) and utils.tracing_is_enabled(*arguments)
