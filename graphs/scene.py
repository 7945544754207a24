"""Scene comprehension alone: segment the photo, describe each candidate, match it with an asset."""

from langgraph.graph import END, START, StateGraph

from grs_agents import nodes
from grs_agents.nodes import Services
from grs_agents.state import RunState

VERDICT = False
"""It ends with a scene, not with a verdict."""


def build() -> StateGraph[RunState, Services, RunState, RunState]:
    """From a photo with depth to a scene description."""
    graph = StateGraph(RunState, context_schema=Services)
    graph.add_node("comprehend", nodes.comprehend)
    graph.add_node("match", nodes.match)
    graph.add_edge(START, "comprehend")
    graph.add_edge("comprehend", "match")
    graph.add_edge("match", END)
    return graph
