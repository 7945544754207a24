"""Two authors write the simulation side by side; the better program gets tests and goes on as in the graph grs."""

from grs_agents.graph import (
    RunGraph,
    add_authors,
    add_competing_authors,
    add_fix_loop,
    add_judging,
    add_perception,
    empty_graph,
)


def build() -> RunGraph:
    """From a photo with depth to a verdict, by the model of the role ``simulation`` or that of ``rival``."""
    graph = empty_graph()
    add_perception(graph, then="generate_task")
    add_competing_authors(graph, "generate_task", then="generate_tests")
    add_authors(graph, "generate_tests", then="run_tests")
    add_judging(graph, fix=add_fix_loop(graph, then="audit"))
    return graph
