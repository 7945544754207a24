"""Ablation ``LLM``: as ``no fix``, and the authors of task and simulation do not see the image (paper, Table 2)."""

from grs_agents.graph import RunGraph, add_authors, add_judging, add_perception, empty_graph, hide_image


def build() -> RunGraph:
    """From a photo with depth to a verdict."""
    graph = empty_graph()
    add_perception(graph, then="hide_image")
    graph.add_node("hide_image", hide_image)
    graph.add_edge("hide_image", "generate_task")
    add_authors(graph, "generate_task", "generate_sim", then="audit")
    add_judging(graph)
    return graph
