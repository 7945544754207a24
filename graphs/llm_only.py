"""Ablation ``LLM``: as ``no fix``, and the authors of task and simulation do not see the image (paper, Table 2)."""

from grs_agents.nodes import RunGraph, author, empty_graph, hide_image, judge, perceive


def build() -> RunGraph:
    """From a photo with depth to a verdict."""
    graph = empty_graph()
    perceive(graph, then="hide_image")
    graph.add_node("hide_image", hide_image)
    graph.add_edge("hide_image", "generate_task")
    author(graph, "generate_task", "generate_sim", then="audit")
    judge(graph)
    return graph
