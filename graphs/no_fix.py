"""Ablation ``no fix``: no tests, the simulation is generated once and audited as it is (paper, Table 2)."""

from grs_agents.graph import RunGraph, add_authors, add_judging, add_perception, empty_graph


def build() -> RunGraph:
    """From a photo with depth to a verdict."""
    graph = empty_graph()
    add_perception(graph, then="generate_task")
    add_authors(graph, "generate_task", "generate_sim", then="audit")
    add_judging(graph)
    return graph
