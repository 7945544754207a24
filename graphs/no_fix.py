"""Ablation ``no fix``: no tests, the simulation is generated once and audited as it is (paper, Table 2)."""

from langgraph.graph import END, START, StateGraph

from grs_agents import nodes
from grs_agents.nodes import Services
from grs_agents.state import RunState


def build() -> StateGraph[RunState, Services, RunState, RunState]:
    """The whole of GRS without tests, router and fixes."""
    graph = StateGraph(RunState, context_schema=Services)
    graph.add_node("comprehend", nodes.comprehend)
    graph.add_node("match", nodes.match)
    graph.add_node("generate_task", nodes.generate_task)
    graph.add_node("generate_sim", nodes.generate_sim)
    graph.add_node("audit", nodes.audit)
    graph.add_node("conclude", nodes.conclude)

    graph.add_edge(START, "comprehend")
    graph.add_edge("comprehend", "match")
    graph.add_edge("match", "generate_task")
    graph.add_conditional_edges("generate_task", nodes.authored, {"ok": "generate_sim", "stop": "conclude"})
    graph.add_conditional_edges("generate_sim", nodes.authored, {"ok": "audit", "stop": "conclude"})
    graph.add_edge("audit", "conclude")
    graph.add_edge("conclude", END)
    return graph
