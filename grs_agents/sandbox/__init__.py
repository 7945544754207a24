"""A sandbox for generated code: a process without network, keys or files, which is stopped when it takes too long."""

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from grs_agents.sandbox.host.sandbox import Sandbox as Sandbox


def __getattr__(name: str) -> Any:
    """Import the host's side on demand: the worker imports this package too and has no use for it."""
    if name == "Sandbox":
        from grs_agents.sandbox.host.sandbox import Sandbox

        return Sandbox
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
