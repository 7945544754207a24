"""As the graph grs, and the author of the simulation may call tools before it hands its program in."""

from grs_agents.graph import (
    RunGraph,
    add_authors,
    add_fix_loop,
    add_judging,
    add_perception,
    add_tool_author,
    empty_graph,
)


def build() -> RunGraph:
    """From a photo with depth to a verdict."""
    graph = empty_graph()
    add_perception(graph, then="generate_task")
    add_authors(graph, "generate_task", then="generate_sim")
    add_tool_author(graph, then="generate_tests")
    add_authors(graph, "generate_tests", then="run_tests")
    add_judging(graph, fix=add_fix_loop(graph, then="audit", revise=True))
    return graph
