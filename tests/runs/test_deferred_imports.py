"""The command line imports LangSmith and LangGraph's client when they are used, and they work then."""

import os
import subprocess
import sys

RUN = """
import os, sys
from typing import TypedDict
from grs_agents.runs.deferred_imports import defer_unused_imports
defer_unused_imports()
from langchain_core.runnables import RunnableLambda
from langgraph.graph import END, START, StateGraph

class State(TypedDict):
    count: int

graph = StateGraph(State)
graph.add_node("add", lambda state: {"count": state["count"] + 1})
graph.add_edge(START, "add")
graph.add_edge("add", END)
assert graph.compile().invoke({"count": 1}) == {"count": 2}
"""
UNUSED = '{"langsmith.client", "langgraph_sdk.client", "httpx"} & set(sys.modules)'


def run(code: str, **variables: str) -> str:
    """What a process prints that runs a graph and then ``code``."""
    kept = {name: value for name, value in os.environ.items() if not name.startswith(("LANGSMITH_", "LANGCHAIN_"))}
    command = [sys.executable, "-c", RUN + code]
    done = subprocess.run(command, capture_output=True, text=True, env={**kept, **variables}, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_what_a_run_does_not_use_is_imported_when_it_is_asked_for() -> None:
    used = f"""
print({UNUSED})
seen = []
RunnableLambda(str).with_listeners(on_end=lambda run: seen.append(type(run))).invoke(1)
import langsmith
from langchain_core.tracers.schemas import Run
from langgraph_sdk import get_client
from langsmith import RunTree, traceable

class Own(Run):
    pass

print(seen[0].__module__, seen[0].__name__, seen[0] in Own.__mro__, isinstance(Own(name="a"), RunTree))
print(get_client.__module__, traceable.__module__, langsmith.utils.tracing_is_enabled())
os.environ["LANGSMITH_TRACING"] = "true"
langsmith.utils.get_env_var.cache_clear()

from langsmith.utils import tracing_is_enabled
print(tracing_is_enabled())
"""
    assert run(used).splitlines() == [
        "set()",
        "langsmith.run_trees RunTree True True",
        "langgraph_sdk._async.client langsmith.run_helpers False",
        "True",
    ]


def test_with_a_variable_of_langsmith_s_it_is_there_from_the_first_on() -> None:
    assert "langsmith.client" in run(f"print({UNUSED})", LANGSMITH_TRACING="false")
