"""What a tool file is given and what it must offer; each tool is also a LangChain ``StructuredTool``."""

from dataclasses import dataclass
from typing import Any, Protocol

from grs_agents.library import Library
from grs_agents.sandbox import Limits, Sandbox


@dataclass(frozen=True)
class ToolContext:
    """The host-side services a tool may use.

    Attributes:
        sandbox: where generated code and MuJoCo run.
        library: the 3D assets, with the run's own proxies laid over.
        limits: what one sandbox call may cost.
    """

    sandbox: Sandbox
    library: Library
    limits: Limits


class Tool(Protocol):
    """A module in ``tools/``: a typed request in, a typed result out."""

    __doc__: str | None
    Request: Any
    Result: Any

    def run(self, request: Any, context: ToolContext) -> Any:
        """Do the work; failures of generated code are values in the result."""
        ...
