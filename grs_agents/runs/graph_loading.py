"""Load a graph, shipped or of the user's own, and name the user's file where the graph is at fault."""

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
"""LangGraph notes on an exception in which node it was raised."""


def load_graph(name: str) -> ModuleType:
    """The graph file ``name``. Raises ConfigError: nothing has that name, or the file has no ``build``."""
    module = content.load_module("graphs", name)
    if not callable(getattr(module, "build", None)):
        raise ConfigError(f"graph {name!r} ({module.__file__}) has no build()", "define what is missing")
    return module


def compile_graph(name: str, checkpointer: "BaseCheckpointSaver[str] | None" = None) -> Any:
    """Build and compile the graph ``name`` for a synchronous run; its coroutine functions run in event loops.

    Raises:
        ConfigError: ``build()`` fails or returns no ``StateGraph``, LangGraph refuses the graph, or a node has what a
            synchronous run cannot have; the message names the file and the line.
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
            _give_synchronous_form(runnable, shown)
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
    """What the nodes and the conditional edges of a ``StateGraph`` call, those of graphs inside it included."""
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
        pending += filter(None, [getattr(runnable, "bound", None)])  # a runnable with arguments of its own


def _give_synchronous_form(runnable: Any, shown: str) -> None:
    """Let a runnable that has a coroutine function alone be called without ``await``."""
    function = getattr(runnable, "afunc", None)
    if function is None or getattr(runnable, "func", None) is not None:
        return
    if inspect.isasyncgenfunction(function):
        raise ConfigError(
            f"{shown}: {function.__name__} is an asynchronous generator",
            "write a function, or a coroutine function that returns the changes of the state",
        )
    runnable.func = _run_in_event_loop(function)


def _run_in_event_loop(function: Callable[..., Any]) -> Callable[..., Any]:
    """A coroutine function as a plain one; each call has an event loop, and the context variables of its caller."""

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
    """The error of a run as one of the user's own code or graph, with the file; None where neither is at fault.

    Args:
        error: what ended the run of the graph.
        name: of the graph.
        since: the file whose frames called the graph; what the traceback has before them does not count.
    """
    from langgraph.errors import GraphBubbleUp, GraphRecursionError, InvalidUpdateError

    file = Path(str(load_graph(name).__file__))
    node = next((found[1] for note in getattr(error, "__notes__", ()) if (found := _NODE_IN_NOTE.search(note))), "")
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
