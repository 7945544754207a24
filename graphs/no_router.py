"""Ablation ``no router``: whatever fails, the simulation program is fixed, never the tests (paper, Table 2)."""

from langgraph.graph import END, START, StateGraph

from grs_agents import nodes
from grs_agents.nodes import Services
from grs_agents.state import RunState


def build() -> StateGraph[RunState, Services, RunState, RunState]:
    """The whole of GRS without the router."""
    graph = StateGraph(RunState, context_schema=Services)
    graph.add_node("comprehend", nodes.comprehend)
    graph.add_node("match", nodes.match)
    graph.add_node("generate_task", nodes.generate_task)
    graph.add_node("generate_sim", nodes.generate_sim)
    graph.add_node("generate_tests", nodes.generate_tests)
    graph.add_node("run_tests", nodes.run_tests)
    graph.add_node("fix_code", nodes.fix_code)
    graph.add_node("audit", nodes.audit)
    graph.add_node("conclude", nodes.conclude)

    graph.add_edge(START, "comprehend")
    graph.add_edge("comprehend", "match")
    graph.add_edge("match", "generate_task")
    graph.add_conditional_edges("generate_task", nodes.authored, {"ok": "generate_sim", "stop": "conclude"})
    graph.add_conditional_edges("generate_sim", nodes.authored, {"ok": "generate_tests", "stop": "conclude"})
    graph.add_conditional_edges("generate_tests", nodes.authored, {"ok": "run_tests", "stop": "conclude"})
    graph.add_conditional_edges("run_tests", nodes.tested, {"audit": "audit", "fix": "fix_code", "stop": "conclude"})
    graph.add_edge("fix_code", "run_tests")
    graph.add_conditional_edges("audit", nodes.audited, {"fix": "fix_code", "stop": "conclude"})
    graph.add_edge("conclude", END)
    return graph
