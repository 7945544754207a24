"""Perception alone: segment the photo, describe each candidate, match it with an asset."""

from langgraph.graph import END

from grs_agents.graph import RunGraph, add_perception, empty_graph

VERDICT = False
"""It ends with a scene, not with a verdict."""


def build() -> RunGraph:
    """From a photo with depth to a scene description."""
    graph = empty_graph()
    add_perception(graph, then=END)
    return graph
