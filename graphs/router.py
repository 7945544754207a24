"""The router: generate a simulation and its tests, run, route, fix, audit, until both agree (paper, Algorithm 1)."""

from langgraph.graph import START

from grs_agents.nodes import RunGraph, author, empty_graph, fix_loop, judge

NEEDS = ("task", "scene")
"""What must be in the state when it starts."""


def build() -> RunGraph:
    """From a task and a scene in the state to a verdict."""
    graph = empty_graph()
    graph.add_edge(START, "generate_sim")
    author(graph, "generate_sim", "generate_tests", then="run_tests")
    judge(graph, fix=fix_loop(graph, then="audit"))
    return graph
