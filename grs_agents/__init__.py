"""GRS: a photo with depth goes in, a validated MuJoCo robot task comes out."""

import sys
from importlib import import_module
from importlib.abc import Loader, MetaPathFinder
from importlib.machinery import ModuleSpec
from types import ModuleType
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from grs_agents.api import Run, RunStream, arun, check, run, stream
    from grs_agents.base.version import __version__
    from grs_agents.toolkit import build_langchain_tools

__all__ = ["Run", "RunStream", "__version__", "arun", "build_langchain_tools", "check", "run", "stream"]
_HOMES = {"__version__": "base.version", "build_langchain_tools": "toolkit"}
"""Modules of the exports outside `grs_agents.api`."""
_RENAMED = {
    "batch": "runs.batch",
    "config": "base.config",
    "content": "base.content",
    "demos": "tasks.demos",
    "errors": "base.errors",
    "export": "tasks.export",
    "files": "base.files",
    "grading": "tasks.grading",
    "nodes": "graph",
    "policies": "graph.policies",
    "questions": "base.questions",
    "state": "graph.state",
    "task_folder": "tasks.task_folder",
    "trace": "base.trace",
    "varied_instances": "tasks.varied_instances",
}
"""Former module names in user code, with the present modules; kept for one release."""


def __getattr__(name: str) -> Any:
    """Import an export on first use, to keep ``import grs_agents`` cheap."""
    if name in __all__:
        return getattr(import_module(f"grs_agents.{_HOMES.get(name, 'api')}"), name)
    if name in _RENAMED:
        return import_module(f"grs_agents.{_RENAMED[name]}")
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


class _RenamedModules(MetaPathFinder, Loader):
    """Imports a module under its former name; both names are the same module."""

    def find_spec(self, fullname: str, path: object = None, target: object = None) -> ModuleSpec | None:
        package, _, rest = fullname.partition(".")
        head, dot, tail = rest.partition(".")
        if package != __name__ or head not in _RENAMED:
            return None
        return ModuleSpec(fullname, self, origin=f"{package}.{_RENAMED[head]}{dot}{tail}")

    def exec_module(self, module: ModuleType) -> None:
        spec = module.__spec__
        if spec is not None and spec.origin is not None:
            sys.modules[spec.name] = import_module(spec.origin)


sys.meta_path.insert(0, _RenamedModules())  # before the path finder, which would load a second copy of a submodule
