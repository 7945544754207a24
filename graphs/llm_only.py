"""Ablation ``LLM``: as ``no fix``, and the authors of task and simulation do not see the image (paper, Table 2)."""

from langgraph.graph import END, START, StateGraph

from grs_agents import nodes
from grs_agents.nodes import Services
from grs_agents.state import RunState


def build() -> StateGraph[RunState, Services, RunState, RunState]:
    """The whole of GRS without tests, router, fixes and image."""
    graph = StateGraph(RunState, context_schema=Services)
    graph.add_node("comprehend", nodes.comprehend)
    graph.add_node("match", nodes.match)
    graph.add_node("hide_image", nodes.hide_image)
    graph.add_node("generate_task", nodes.generate_task)
    graph.add_node("generate_sim", nodes.generate_sim)
    graph.add_node("audit", nodes.audit)
    graph.add_node("conclude", nodes.conclude)

    graph.add_edge(START, "comprehend")
    graph.add_edge("comprehend", "match")
    graph.add_edge("match", "hide_image")
    graph.add_edge("hide_image", "generate_task")
    graph.add_conditional_edges("generate_task", nodes.authored, {"ok": "generate_sim", "stop": "conclude"})
    graph.add_conditional_edges("generate_sim", nodes.authored, {"ok": "audit", "stop": "conclude"})
    graph.add_edge("audit", "conclude")
    graph.add_edge("conclude", END)
    return graph
