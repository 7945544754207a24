"""The nodes and edges of the shipped graphs, in segments that the files of ``graphs/`` join.

The graph ``grs`` has all of them but the competing authors and the author with tools::

    START > read > find_table > segment > describe > match > register > settle    perception
                                segment > group > describe                        with a model that sees pictures
                                          describe < register                     while residual candidates are left
    settle, read > edit > generate_task                                           with the edits of a person
    settle > generate_task > generate_sim > generate_tests > run_tests            authors
    run_tests > audit > conclude > END                                            while tests and audit pass
    run_tests, audit > route > fix_code, fix_tests > run_tests                    while they fail and fixes are left
                       route > fix_task > generate_sim                            once, if the task cannot be done

Each segment leads on to the node ``then``. An author whose model gives no usable reply leads to ``conclude``.
"""

from collections.abc import Hashable
from typing import Final, TypeAlias

from langgraph.graph import END, START, StateGraph

from grs_agents.graph.authoring import (
    choose_draft,
    draft_rival,
    draft_simulation,
    generate_sim,
    generate_sim_with_tools,
    generate_task,
    generate_tests,
    next_step_after_author,
    next_steps_to_drafts,
)
from grs_agents.graph.editing import edit_scene, review_scene
from grs_agents.graph.fixing import fix_code, fix_task, fix_tests
from grs_agents.graph.grouping import group_candidates, next_step_after_segment
from grs_agents.graph.judging import (
    audit_task,
    conclude_with_best_version,
    decide_what_to_fix,
    next_step_after_audit,
    next_step_after_fix_task,
    next_step_after_tests,
    read_routing_verdict,
    run_tests,
)
from grs_agents.graph.perceive import (
    describe_candidates,
    find_table,
    match_candidates_to_assets,
    next_step_after_read,
    next_step_after_register,
    next_step_after_settle,
    read_photo_into_run,
    register_assets_in_photo,
    segment_photo,
    settle_objects,
)
from grs_agents.graph.services import Services
from grs_agents.graph.state import RunState

RunGraph: TypeAlias = StateGraph[RunState, Services, RunState, RunState]
AUTHORS: Final = {"generate_task": generate_task, "generate_sim": generate_sim, "generate_tests": generate_tests}


def empty_graph() -> RunGraph:
    """A graph over ``RunState`` whose nodes get the ``Services`` of the run."""
    return StateGraph(RunState, context_schema=Services)


def add_perception(graph: RunGraph, then: str, review: bool = False) -> None:
    """From the start to objects at rest in MuJoCo (paper, Scene Comprehension); the scene of another run is copied.

    A model that sees pictures regroups the segments before they are described. Residual candidates, which show once the
    first objects are placed, are described and matched in a second pass. The edits of a person correct the scene; with
    ``review`` a person is asked for them.
    """
    graph.add_node("read", read_photo_into_run)
    graph.add_node("find_table", find_table)
    graph.add_node("segment", segment_photo)
    graph.add_node("group", group_candidates)
    graph.add_node("describe", describe_candidates)
    graph.add_node("match", match_candidates_to_assets)
    graph.add_node("register", register_assets_in_photo)
    graph.add_node("settle", settle_objects)
    graph.add_node("edit", edit_scene)
    settled = then
    if review:
        settled = "review"
        graph.add_node("review", review_scene)
        graph.add_conditional_edges("review", next_step_after_settle, {"edit": "edit", "done": then})

    graph.add_edge(START, "read")
    after_read: dict[Hashable, str] = {"find_table": "find_table", "edit": "edit", "done": settled}
    graph.add_conditional_edges("read", next_step_after_read, after_read)
    graph.add_edge("find_table", "segment")
    graph.add_conditional_edges("segment", next_step_after_segment, ["group", "describe"])
    graph.add_edge("group", "describe")
    graph.add_edge("describe", "match")
    graph.add_edge("match", "register")
    graph.add_conditional_edges("register", next_step_after_register, ["describe", "settle"])
    graph.add_conditional_edges("settle", next_step_after_settle, {"edit": "edit", "done": settled})
    graph.add_edge("edit", then)


def add_authors(graph: RunGraph, *names: str, then: str) -> None:
    """The authors ``names`` in sequence.

    Raises:
        KeyError: a name is none of ``AUTHORS``.
    """
    for name, following in zip(names, (*names[1:], then), strict=True):
        graph.add_node(name, AUTHORS[name])
        graph.add_conditional_edges(name, next_step_after_author, {"ok": following, "stop": "conclude"})


def add_competing_authors(graph: RunGraph, task_author: str, then: str) -> None:
    """The author of the task, then two of the simulation in parallel, of whose programs the better is kept.

    LangGraph merges the updates of both, since ``drafts`` of ``RunState`` has a reducer.
    """
    graph.add_node(task_author, AUTHORS[task_author])
    graph.add_node("choose_draft", choose_draft)
    graph.add_node("draft_sim", draft_simulation)
    graph.add_node("draft_rival", draft_rival)

    graph.add_conditional_edges(task_author, next_steps_to_drafts, ["draft_sim", "draft_rival", "conclude"])
    graph.add_edge(["draft_sim", "draft_rival"], "choose_draft")
    graph.add_conditional_edges("choose_draft", next_step_after_author, {"ok": then, "stop": "conclude"})


def add_tool_author(graph: RunGraph, then: str) -> None:
    """The author of the simulation as an agent that may check, look and measure before it hands its program in."""
    graph.add_node("generate_sim", generate_sim_with_tools)
    graph.add_conditional_edges("generate_sim", next_step_after_author, {"ok": then, "stop": "conclude"})


def add_fix_loop(graph: RunGraph, then: str, router: bool = True, revise: bool = False) -> str:
    """Run the tests, and fix until they pass or the fixes are used up (paper, Algorithm 1).

    Args:
        router: let the policy choose between fixes of the program, the tests and the task; False: fix the program.
        revise: let a task that was defined in the run and cannot be done be revised, once.

    Returns:
        The node that failures go to, for ``add_judging``: ``route``, or ``fix_code`` without a router.
    """
    failed = "route" if router else "fix_code"
    graph.add_node("run_tests", run_tests)
    graph.add_node("fix_code", fix_code)
    graph.add_conditional_edges("run_tests", next_step_after_tests, {"audit": then, "fix": failed, "stop": "conclude"})
    graph.add_edge("fix_code", "run_tests")
    if router:
        graph.add_node("route", decide_what_to_fix)
        graph.add_node("fix_tests", fix_tests)
        task_fixer = "fix_task" if revise else "fix_code"
        fixers: dict[Hashable, str] = {"fix_code": "fix_code", "fix_test": "fix_tests", "fix_task": task_fixer}
        graph.add_conditional_edges("route", read_routing_verdict, fixers)
        graph.add_edge("fix_tests", "run_tests")
    if revise:
        graph.add_node("fix_task", fix_task)
        after_revision: dict[Hashable, str] = {"write": "generate_sim", "judge": "run_tests"}
        graph.add_conditional_edges("fix_task", next_step_after_fix_task, after_revision)
    return failed


def add_judging(graph: RunGraph, fix: str | None = None) -> None:
    """Audit the program and conclude the run. A failed audit leads to the node ``fix``, else to ``conclude``."""
    graph.add_node("audit", audit_task)
    graph.add_node("conclude", conclude_with_best_version)
    if fix is None:
        graph.add_edge("audit", "conclude")
    else:
        graph.add_conditional_edges("audit", next_step_after_audit, {"fix": fix, "stop": "conclude"})
    graph.add_edge("conclude", END)
