"""What a tool file is given and what it must offer; each tool is also a LangChain ``StructuredTool``."""

from __future__ import annotations

import ast
import inspect
import textwrap
from collections.abc import Callable, Iterator, Sequence
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

    The docstring under a field is what a model reads of it: say the unit and the frame. It is looked up when a schema
    is asked for: pydantic's `use_attribute_docstrings` searches all loaded modules whenever such a class is made.
    """

    @classmethod
    def describe_fields(cls) -> None:
        """Give each field the docstring under it as its description."""
        for kind in cls.__mro__:
            if issubclass(kind, ToolRequest) and kind is not ToolRequest:
                for name, text in _docstrings_of_fields(kind):
                    cls.model_fields[name].description = text
        cls.model_rebuild(force=True)

    @classmethod
    def model_json_schema(cls, *arguments: Any, **options: Any) -> dict[str, Any]:
        """As pydantic's, with the descriptions."""
        cls.describe_fields()
        return super().model_json_schema(*arguments, **options)


def _docstrings_of_fields(kind: type) -> Iterator[tuple[str, str]]:
    """The names of a class's own fields that have a docstring, with it."""
    (described,) = ast.parse(textwrap.dedent(inspect.getsource(kind))).body
    for field, text in pairwise(cast(ast.ClassDef, described).body):
        match field, text:
            case ast.AnnAssign(target=ast.Name(id=name)), ast.Expr(value=ast.Constant(value=str() as words)):
                yield name, inspect.cleandoc(words)
            case _:
                pass


@dataclass(frozen=True)
class ToolContext:
    """The host-side services a tool may use."""

    sandbox: Sandbox
    library: Library  # the 3D assets, with the run's own proxies laid over
    limits: Limits  # what one sandbox call may cost
    say: Callable[[str], object] = str  # tell the person who waits, in one line; nobody hears it outside a run


class Tool(Protocol):
    """A module in ``tools/``: a typed request in, a typed result out."""

    __doc__: str | None
    Request: Any
    Result: Any

    def run(self, request: Any, context: ToolContext) -> Any:
        """Do the work; failures of generated code are values in the result."""
        ...


def load_tool(name: str) -> Tool:
    """The tool file ``name``.

    Raises:
        UnknownNameError: nothing has that name.
        InputError: the file offers no ``Request``, ``Result`` and ``run``.
    """
    module = content.load_module("tools", name)
    missing = [part for part in ("Request", "Result", "run") if not hasattr(module, part)]
    if missing:
        raise InputError(f"tool {name!r} ({module.__file__}) has no {', '.join(missing)}", "define what is missing")
    return cast(Tool, module)


def json_tool_names() -> list[str]:
    """The tools whose requests are plain JSON, which any agent framework can therefore call."""
    return [name for name in content.content_names("tools") if _has_json_request(load_tool(name))]


def build_langchain_tools(context: ToolContext, names: Sequence[str] | None = None) -> list[StructuredTool]:
    """The tools as LangChain ``StructuredTool``s: the tool's request is the schema, its result comes back as JSON.

    Args:
        context: the services they run with.
        names: which tools; every tool of `json_tool_names` otherwise.

    Raises:
        UnknownNameError: a name that no tool has.
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
    """The library of the folders ``roots``; the shipped one if there are none."""
    return Library(*(Path(root) for root in roots))


def list_folders_to_read(library_roots: Sequence[str], robot: str) -> tuple[Path, ...]:
    """The folders that a simulation with these assets and this arm reads, beside the shipped ones."""
    arm = (Path(robot).parent,) if Path(robot).suffix else ()
    return (*(Path(root) for root in library_roots), *arm)


def _has_json_request(tool: Tool) -> bool:
    return isinstance(tool.Request, type) and issubclass(tool.Request, BaseModel)


def _make_tool_function(tool: Tool, context: ToolContext) -> Callable[..., dict[str, Any]]:
    def call(**arguments: Any) -> dict[str, Any]:
        return cast(BaseModel, tool.run(tool.Request(**arguments), context)).model_dump(mode="json")

    return call
