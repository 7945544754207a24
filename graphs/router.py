"""The router: generate a simulation and its tests, run, route, fix, audit, until both agree (paper, Algorithm 1)."""

from langgraph.graph import START

from grs_agents.graph import RunGraph, add_authors, add_fix_loop, add_judging, empty_graph

NEEDS = ("task", "scene")
"""What must be in the state when it starts."""


def build() -> RunGraph:
    """From a task and a scene in the state to a verdict."""
    graph = empty_graph()
    graph.add_edge(START, "generate_sim")
    add_authors(graph, "generate_sim", "generate_tests", then="run_tests")
    add_judging(graph, fix=add_fix_loop(graph, then="audit"))
    return graph
