"""Ablation ``no fix``: no tests, the simulation is generated once and audited as it is (paper, Table 2)."""

from grs_agents.nodes import RunGraph, author, empty_graph, judge, perceive


def build() -> RunGraph:
    """From a photo with depth to a verdict."""
    graph = empty_graph()
    perceive(graph, then="generate_task")
    author(graph, "generate_task", "generate_sim", then="audit")
    judge(graph)
    return graph
