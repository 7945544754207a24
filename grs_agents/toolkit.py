"""Interface of tool files, and their adapter to LangChain's ``StructuredTool``."""

from __future__ import annotations

import ast
import inspect
import textwrap
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol, cast

from pydantic import BaseModel

from grs_agents.base import Frozen, content
from grs_agents.base.config.schema import Limits
from grs_agents.base.errors import InputError
from grs_agents.library.library import Library
from grs_agents.sandbox.host.sandbox import Sandbox

if TYPE_CHECKING:
    from langchain_core.tools import StructuredTool


class ToolRequest(Frozen):
    """A request that any agent framework can send as JSON.

    A model reads the docstring under a field: state unit and frame. Docstrings are looked up when a schema is
    requested, since pydantic's `use_attribute_docstrings` searches all loaded modules for each class.
    """

    @classmethod
    def describe_fields(cls) -> None:
        """Set each field's description to the docstring under it."""
        for kind in cls.__mro__:
            if issubclass(kind, ToolRequest) and kind is not ToolRequest:
                (definition,) = ast.parse(textwrap.dedent(inspect.getsource(kind))).body
                for field, text in pairwise(cast(ast.ClassDef, definition).body):
                    match field, text:
                        case ast.AnnAssign(target=ast.Name(id=name)), ast.Expr(value=ast.Constant(value=str() as doc)):
                            cls.model_fields[name].description = inspect.cleandoc(doc)
                        case _:
                            pass
        cls.model_rebuild(force=True)

    @classmethod
    def model_json_schema(cls, *arguments: Any, **options: Any) -> dict[str, Any]:
        """As pydantic's, with descriptions."""
        cls.describe_fields()
        return super().model_json_schema(*arguments, **options)


@dataclass(frozen=True)
class ToolContext:
    """Host-side services of a tool."""

    sandbox: Sandbox
    library: Library  # the 3D assets, overlaid with the proxies of the run
    limits: Limits  # of a sandbox call
    say: Callable[[str], object] = str  # shows a line of text to the user; no effect outside a run


class Tool(Protocol):
    """A module in ``tools/`` with a typed request and a typed result."""

    __doc__: str | None
    Request: Any
    Result: Any

    def run(self, request: Any, context: ToolContext) -> Any:
        """Execute a request; failures of generated code are values in the result."""
        ...


def load_tool(name: str) -> Tool:
    """The tool file ``name``.

    Raises:
        UnknownNameError: no tool has this name.
        InputError: the file lacks ``Request``, ``Result`` or ``run``.
    """
    module = content.load_module("tools", name)
    missing = [part for part in ("Request", "Result", "run") if not hasattr(module, part)]
    if missing:
        raise InputError(f"tool {name!r} ({module.__file__}) has no {', '.join(missing)}", "define what is missing")
    return cast(Tool, module)


def json_tool_names() -> list[str]:
    """Tools whose requests are plain JSON, callable by any agent framework."""
    return [name for name in content.content_names("tools") if _has_json_request(load_tool(name))]


def build_langchain_tools(context: ToolContext, names: Sequence[str] | None = None) -> list[StructuredTool]:
    """Tools as LangChain ``StructuredTool``s: the request is the schema, the result is JSON.

    Args:
        context: their services.
        names: of the tools; by default all of `json_tool_names`.

    Raises:
        UnknownNameError: no tool has this name.
        InputError: a tool whose request is not plain JSON.
    """
    from langchain_core.tools import StructuredTool

    structured: list[StructuredTool] = []
    for name in json_tool_names() if names is None else names:
        tool = load_tool(name)
        if not _has_json_request(tool):
            raise InputError(f"tool {name!r} takes arrays, not JSON", f"use one of: {', '.join(json_tool_names())}")
        if issubclass(tool.Request, ToolRequest):
            tool.Request.describe_fields()
        structured.append(
            StructuredTool.from_function(
                func=_make_tool_function(tool, context),
                name=name,
                description=(tool.__doc__ or name).strip().splitlines()[0],
                args_schema=tool.Request,
            )
        )
    return structured


def open_library(roots: Sequence[str]) -> Library:
    """The library of the folders ``roots``, by default the shipped library."""
    return Library(*(Path(root) for root in roots))


def list_folders_to_read(library_roots: Sequence[str], robot: str) -> tuple[Path, ...]:
    """Folders besides the shipped folders that a simulation with these assets and this arm reads."""
    arm = (Path(robot).parent,) if Path(robot).suffix else ()
    return (*(Path(root) for root in library_roots), *arm)


def _has_json_request(tool: Tool) -> bool:
    return isinstance(tool.Request, type) and issubclass(tool.Request, BaseModel)


def _make_tool_function(tool: Tool, context: ToolContext) -> Callable[..., dict[str, Any]]:
    def call(**arguments: Any) -> dict[str, Any]:
        return cast(BaseModel, tool.run(tool.Request(**arguments), context)).model_dump(mode="json")

    return call
