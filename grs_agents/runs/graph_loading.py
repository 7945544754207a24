"""Loading of shipped and user graphs; errors name the user's file if it is at fault."""

import asyncio
import inspect
import re
import sqlite3
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextvars import copy_context
from functools import wraps
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING, Any, cast

from grs_agents.base import content
from grs_agents.base.errors import ConfigError, GrsError
from grs_agents.graph.state import RunState

if TYPE_CHECKING:
    from langgraph.checkpoint.base import BaseCheckpointSaver

_NODE_IN_NOTE = re.compile(r"During task with name '([^']*)'")
"""LangGraph's note on an exception, naming the node that raised it."""


def load_graph(name: str) -> ModuleType:
    """Load the graph file ``name``. Raises ConfigError: unknown name, or a file without ``build``."""
    module = content.load_module("graphs", name)
    if not callable(getattr(module, "build", None)):
        raise ConfigError(f"graph {name!r} ({module.__file__}) has no build()", "define what is missing")
    return module


def compile_graph(name: str, checkpointer: "BaseCheckpointSaver[str] | None" = None) -> Any:
    """Build and compile the graph ``name`` for a synchronous run; coroutine functions run in event loops.

    Raises:
        ConfigError: ``build()`` fails or returns no ``StateGraph``, LangGraph refuses the graph, or a node cannot run
            synchronously; the message names the file and the line.
    """
    from langgraph.graph import StateGraph

    module = load_graph(name)
    shown = f"graph {name!r} ({module.__file__})"
    try:
        graph: Any = module.build()
        if not isinstance(graph, StateGraph):
            raise ConfigError(
                f"{shown}: build() returns {type(cast(object, graph)).__name__}", "return a StateGraph, not compiled"
            )
        compiled: Any = cast(Any, graph).compile(checkpointer=checkpointer)
        for runnable in _runnables_of_graph(graph):
            function = getattr(runnable, "afunc", None)
            if function is None or getattr(runnable, "func", None) is not None:
                continue
            if inspect.isasyncgenfunction(function):
                raise ConfigError(
                    f"{shown}: {function.__name__} is an asynchronous generator",
                    "write a function, or a coroutine function that returns the changes of the state",
                )
            runnable.func = _run_in_event_loop(function)
    except GrsError:
        raise
    except (Exception, SystemExit) as error:
        place = content.locate_user_code(error) or str(module.__file__)
        raise ConfigError(
            f"graph {name!r} cannot be built: {place}: {content.describe_exception(error)}", "mend its build()"
        ) from error
    for node, spec in compiled.nodes.items():
        if getattr(spec, "timeout", None) is not None:
            raise ConfigError(
                f"{shown}: node {node!r} has a timeout, which LangGraph keeps in asynchronous runs alone",
                "leave it out, or end what takes long inside the node",
            )
    return compiled


def _runnables_of_graph(graph: Any) -> Iterator[Any]:
    """The runnables of a ``StateGraph``'s nodes and conditional edges, nested graphs included."""
    pending: list[Any] = [spec.runnable for spec in graph.nodes.values()]
    pending += [branch.path for branches in graph.branches.values() for branch in branches.values()]
    seen: set[int] = set()
    while pending:
        runnable = pending.pop()
        if id(runnable) in seen:
            continue
        seen.add(id(runnable))
        yield runnable
        if (builder := getattr(runnable, "builder", None)) is not None:  # a compiled graph
            pending += _runnables_of_graph(builder)
        pending += getattr(runnable, "steps", ())  # a sequence
        pending += filter(None, [getattr(runnable, "bound", None)])  # a runnable with bound arguments


def _run_in_event_loop(function: Callable[..., Any]) -> Callable[..., Any]:
    """A synchronous form of a coroutine function; each call has an event loop and its caller's context variables."""

    @wraps(function)
    def run(*arguments: Any, **named: Any) -> Any:
        try:
            asyncio.get_running_loop()
        except RuntimeError:
            return asyncio.run(function(*arguments, **named))
        with ThreadPoolExecutor(1) as pool:  # a notebook's loop is busy with the caller
            return pool.submit(copy_context().run, asyncio.run, function(*arguments, **named)).result()

    return run


def explain_graph_error(error: Exception, name: str, since: str) -> ConfigError | None:
    """Convert an error raised by user code or a user's graph to a ConfigError that names the file; None for other
    errors.

    Args:
        error: the error that ended the run.
        name: of the graph.
        since: the file that called the graph; earlier frames of the traceback are ignored.
    """
    from langgraph.errors import GraphBubbleUp, GraphRecursionError, InvalidUpdateError

    file = Path(str(load_graph(name).__file__))
    node = next((match[1] for note in getattr(error, "__notes__", ()) if (match := _NODE_IN_NOTE.search(note))), "")
    of_graph = f"{f'node {node!r} of ' if node else ''}graph {name!r}"
    below = [Path(frame.filename) for frame in content.list_frames(error, since)]
    in_langgraph = below[:1] != [] and "langgraph" in below[0].parts
    explained: tuple[str, str] | None = None
    if isinstance(error, GraphBubbleUp | sqlite3.Error | MemoryError):
        pass
    elif isinstance(error, GraphRecursionError):
        steps = next(iter(re.findall(r"limit of (\d+)", str(error))), "the allowed")
        explained = (
            f"graph {name!r} ({file}) did not end within {steps} steps",
            "end its loop, or allow more with --set recursion_limit=N",
        )
    elif place := content.locate_user_code(error, since):
        explained = (
            f"{place}, in {of_graph}: {content.describe_exception(error)}",
            "mend it; --resume goes on at the node that failed",
        )
    elif content.is_shipped(file):
        pass
    elif isinstance(error, InvalidUpdateError):
        explained = f"{of_graph} ({file}): {str(error).splitlines()[0]}", "mend what its nodes return"
    elif isinstance(error, KeyError) and error.args and error.args[0] in RunState.__annotations__:
        explained = (
            f"{of_graph} ({file}) needs {error.args[0]!r} in the state, and no node before it wrote that",
            "add the node that does, before it",
        )
    elif in_langgraph and not any(path.is_relative_to(content.package_root()) for path in below):
        explained = f"{of_graph} ({file}): {content.describe_exception(error)}", "mend the graph"
    return None if explained is None else ConfigError(*explained)
