"""As the graph grs, and a person may correct the scene before a task is set in it."""

from grs_agents.graph import RunGraph, add_authors, add_fix_loop, add_judging, add_perception, empty_graph


def build() -> RunGraph:
    """From a photo with depth to a verdict."""
    graph = empty_graph()
    add_perception(graph, then="generate_task", review=True)
    add_authors(graph, "generate_task", "generate_sim", "generate_tests", then="run_tests")
    add_judging(graph, fix=add_fix_loop(graph, then="audit", revise=True))
    return graph
