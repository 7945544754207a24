"""Segments that the graphs share. Each adds its nodes and edges to a graph, and leads on to the node ``then``."""

from collections.abc import Hashable
from itertools import pairwise
from typing import Final, TypeAlias

from langgraph.graph import END, START, StateGraph

from grs_agents.graph.authoring import generate_sim, generate_task, generate_tests
from grs_agents.graph.competing_drafts import choose_draft, draft_rival, draft_simulation
from grs_agents.graph.comprehension import (
    describe_candidates,
    find_table,
    match_candidates_to_assets,
    next_step_after_read,
    next_step_after_register,
    read_photo_into_run,
    register_assets_in_photo,
    segment_photo,
    settle_objects,
)
from grs_agents.graph.fixing import fix_code, fix_task, fix_tests
from grs_agents.graph.judging import (
    audit_task,
    conclude_with_best_version,
    decide_what_to_fix,
    next_step_after_audit,
    next_step_after_author,
    next_step_after_fix_task,
    next_step_after_tests,
    read_routing_verdict,
    run_tests,
)
from grs_agents.graph.services import Services
from grs_agents.graph.state import RunState
from grs_agents.graph.tool_author.author import generate_sim_with_tools

RunGraph: TypeAlias = StateGraph[RunState, Services, RunState, RunState]

PERCEPTION: Final = {
    "read": read_photo_into_run,
    "find_table": find_table,
    "segment": segment_photo,
    "describe": describe_candidates,
    "match": match_candidates_to_assets,
    "register": register_assets_in_photo,
    "settle": settle_objects,
}
AUTHORS: Final = {"generate_task": generate_task, "generate_sim": generate_sim, "generate_tests": generate_tests}


def empty_graph() -> RunGraph:
    """A graph over ``RunState`` whose nodes get the ``Services`` of the run."""
    return StateGraph(RunState, context_schema=Services)


def add_perception(graph: RunGraph, then: str) -> None:
    """From the start: from the photo to objects at rest in MuJoCo (paper, Scene Comprehension).

    A scene that another run made is taken over as it is. Residual candidates, which show once the first objects are
    placed, are described and matched in a second pass.
    """
    for name, step in PERCEPTION.items():
        graph.add_node(name, step)
    graph.add_edge(START, "read")
    graph.add_conditional_edges("read", next_step_after_read, {"find_table": "find_table", "done": then})
    for source, target in pairwise(list(PERCEPTION)[1:-1]):
        graph.add_edge(source, target)
    graph.add_conditional_edges("register", next_step_after_register, ["describe", "settle"])
    graph.add_edge("settle", then)


def add_authors(graph: RunGraph, *names: str, then: str) -> None:
    """The authors ``names`` one after another. A run whose author gave no usable answer goes on to ``conclude``.

    Raises:
        KeyError: a name is none of ``AUTHORS``.
    """
    for name, following in zip(names, (*names[1:], then), strict=True):
        graph.add_node(name, AUTHORS[name])
        graph.add_conditional_edges(name, next_step_after_author, {"ok": following, "stop": "conclude"})


def add_competing_authors(graph: RunGraph, task_author: str, then: str) -> None:
    """The author of the task, then two of the simulation side by side, of whose programs the better one is kept.

    LangGraph merges what both add to ``drafts``, since that key of the state has a reducer.
    """
    drafts = {"draft_sim": draft_simulation, "draft_rival": draft_rival}
    graph.add_node(task_author, AUTHORS[task_author])
    graph.add_node("choose_draft", choose_draft)
    for name, step in drafts.items():
        graph.add_node(name, step)
    graph.add_conditional_edges(task_author, next_steps_to_drafts, [*drafts, "conclude"])
    graph.add_edge(list(drafts), "choose_draft")
    graph.add_conditional_edges("choose_draft", next_step_after_author, {"ok": then, "stop": "conclude"})


def add_tool_author(graph: RunGraph, then: str) -> None:
    """The author of the simulation as an agent that may check, look and measure before it hands its program in."""
    graph.add_node("generate_sim", generate_sim_with_tools)
    graph.add_conditional_edges("generate_sim", next_step_after_author, {"ok": then, "stop": "conclude"})


def next_steps_to_drafts(state: RunState) -> list[str]:
    """Both authors, unless there is no task."""
    return ["conclude"] if next_step_after_author(state) == "stop" else ["draft_sim", "draft_rival"]


def add_fix_loop(graph: RunGraph, then: str, router: bool = True, revise: bool = False) -> str:
    """Run the tests, and fix until they pass or the fixes are used up (paper, Algorithm 1).

    With ``revise``, a task that was defined in the run and cannot be done may be revised, once.

    Returns:
        the node that a failure goes to: ``route``, or ``fix_code`` without a router.
    """
    first = "route" if router else "fix_code"
    graph.add_node("run_tests", run_tests)
    graph.add_node("fix_code", fix_code)
    graph.add_conditional_edges("run_tests", next_step_after_tests, {"audit": then, "fix": first, "stop": "conclude"})
    graph.add_edge("fix_code", "run_tests")
    if router:
        graph.add_node("route", decide_what_to_fix)
        graph.add_node("fix_tests", fix_tests)
        fixers: dict[Hashable, str] = {
            "fix_code": "fix_code",
            "fix_test": "fix_tests",
            "fix_task": "fix_task" if revise else "fix_code",
        }
        graph.add_conditional_edges("route", read_routing_verdict, fixers)
        graph.add_edge("fix_tests", "run_tests")
    if revise:
        graph.add_node("fix_task", fix_task)
        graph.add_conditional_edges(
            "fix_task", next_step_after_fix_task, {"write": "generate_sim", "judge": "run_tests"}
        )
    return first


def add_judging(graph: RunGraph, fix: str | None = None) -> None:
    """Audit the program and conclude the run. What the audit finds goes to the node ``fix``, if there is one."""
    graph.add_node("audit", audit_task)
    graph.add_node("conclude", conclude_with_best_version)
    if fix is None:
        graph.add_edge("audit", "conclude")
    else:
        graph.add_conditional_edges("audit", next_step_after_audit, {"fix": fix, "stop": "conclude"})
    graph.add_edge("conclude", END)
