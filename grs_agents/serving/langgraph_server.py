"""The graphs for LangGraph's server and clients: ``langgraph dev`` loads them as listed in ``langgraph.json``.

A request names the scene, and each node's changes stream back; the run leaves an ordinary run folder. Settings
come from ``GRS_*`` variables and from the request.
"""

from contextlib import AbstractContextManager
from dataclasses import replace
from pathlib import Path
from typing import Any

from langchain_core.runnables import RunnableConfig
from langgraph.errors import GraphInterrupt
from langgraph.graph import END, START, StateGraph

from grs_agents.base.config.load import EffectiveConfig, load_config
from grs_agents.base.errors import InputError
from grs_agents.base.trace.log import EventLog
from grs_agents.graph.state import RunState, parse_state, state_as_json
from grs_agents.perception.reading.scene_source import resolve_scene_path
from grs_agents.runs.execution import execute_run
from grs_agents.runs.graph_loading import load_graph
from grs_agents.runs.run_opening import GIVEN, RunOrder
from grs_agents.views.live_views import attach_live_views


class ServedRunState(RunState):
    """The final state of a run, with its folder."""

    folder: str  # the run folder, for `grs show`, `grs report` and `grs replay`


_waiting: dict[str, tuple[Path, EffectiveConfig]] = {}
"""Folder and configuration of each run that waits for a reply, by the server's thread id."""


def build_served_graph(name: str) -> StateGraph[ServedRunState, None, RunState, ServedRunState]:
    """The graph ``name`` with the services of ``grs run``: sandbox, models, event log, recording.

    The request's state has ``scene_path`` and the other inputs of the graph; its ``configurable`` may have
    ``set``, a list of settings as for ``--set``.
    """

    def run(state: RunState, config: RunnableConfig) -> dict[str, Any]:
        settings: list[str] = [*config.get("configurable", {}).get("set", ()), f"graph={name}"]
        if not state.get("scene_path"):
            remedy = "give the state a scene_path: a folder, a file, bop:..., or a sample scene by its name"
            raise InputError("the request names no scene", remedy)
        scene = resolve_scene_path(Path(state["scene_path"]))
        thread = str(config.get("configurable", {}).get("thread_id", ""))
        waiting = _waiting.pop(thread, None)
        given = dict(parse_state({key: value for key, value in state.items() if key not in GIVEN}))
        command = "run" if getattr(load_graph(name), "VERDICT", True) else "scene"
        order = RunOrder(command, scene, load_config(None, settings), given=given, nested=True)
        if waiting is not None:
            folder, config_before = waiting
            order = replace(order, out=folder, resume=True, config=config_before)
        folders: list[Path] = []

        def attach_views(folder: Path, log: EventLog) -> AbstractContextManager[None]:
            folders.append(folder)
            return attach_live_views(folder, log)

        try:
            ended = execute_run(order, attach_views)
        except GraphInterrupt:
            _waiting[thread] = folders[-1], order.config
            raise
        if ended.problem is not None:
            raise ended.problem
        return {**state_as_json(ended.state), "folder": str(ended.folder)}

    graph = StateGraph(ServedRunState, input_schema=RunState, output_schema=ServedRunState)
    graph.add_node(name, run)
    graph.add_edge(START, name)
    graph.add_edge(name, END)
    return graph


grs, router, scene = build_served_graph("grs"), build_served_graph("router"), build_served_graph("scene")
best_of, tool_author = build_served_graph("best_of"), build_served_graph("tool_author")
grs_review = build_served_graph("grs_review")
no_router, no_fix, llm_only = (
    build_served_graph("no_router"),
    build_served_graph("no_fix"),
    build_served_graph("llm_only"),
)
