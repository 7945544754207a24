"""The whole of GRS: from a photo with depth to a validated task (paper, Figure 2)."""

from grs_agents.nodes import RunGraph, author, empty_graph, fix_loop, judge, perceive


def build() -> RunGraph:
    """From a photo with depth to a verdict."""
    graph = empty_graph()
    perceive(graph, then="generate_task")
    author(graph, "generate_task", "generate_sim", "generate_tests", then="run_tests")
    judge(graph, fix=fix_loop(graph, then="audit"))
    return graph
