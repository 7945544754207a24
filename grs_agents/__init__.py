"""GRS: a photo with depth goes in, a validated MuJoCo robot task comes out."""

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from grs_agents.toolkit import build_langchain_tools

    __version__: str

__all__ = ["__version__", "build_langchain_tools"]


def __getattr__(name: str) -> Any:
    """Find out only when asked: ``import grs_agents`` stays free."""
    if name == "build_langchain_tools":
        from grs_agents.toolkit import build_langchain_tools

        return build_langchain_tools
    if name == "__version__":
        from importlib.metadata import PackageNotFoundError, version

        try:
            return version("grs-agents")
        except PackageNotFoundError:  # a source tree that was never installed
            return "0.0.0"
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
