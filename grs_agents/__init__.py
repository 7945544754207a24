"""GRS: a photo with depth goes in, a validated MuJoCo robot task comes out."""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from grs_agents.api import Run, RunStream, arun, check, run, stream
    from grs_agents.toolkit import build_langchain_tools
    from grs_agents.version import __version__

__all__ = ["Run", "RunStream", "__version__", "arun", "build_langchain_tools", "check", "run", "stream"]
_HOMES = {"__version__": "version", "build_langchain_tools": "toolkit"}
"""The modules of exports that are not in `grs_agents.api`."""


def __getattr__(name: str) -> Any:
    """Find out only when asked: ``import grs_agents`` stays free."""
    if name in __all__:
        return getattr(import_module(f"grs_agents.{_HOMES.get(name, 'api')}"), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
