"""The router: generate a simulation and its tests, run, route, fix, audit, until both agree (paper, Algorithm 1)."""

from langgraph.graph import END, START, StateGraph

from grs_agents import nodes
from grs_agents.nodes import Services
from grs_agents.state import RunState

NEEDS = ("task", "scene")
"""What must be in the state when it starts."""


def build() -> StateGraph[RunState, Services, RunState, RunState]:
    """The state machine, from a task and a scene in the state to a verdict."""
    graph = StateGraph(RunState, context_schema=Services)
    graph.add_node("generate_sim", nodes.generate_sim)
    graph.add_node("generate_tests", nodes.generate_tests)
    graph.add_node("run_tests", nodes.run_tests)
    graph.add_node("route", nodes.route)
    graph.add_node("fix_code", nodes.fix_code)
    graph.add_node("fix_tests", nodes.fix_tests)
    graph.add_node("audit", nodes.audit)
    graph.add_node("conclude", nodes.conclude)

    graph.add_edge(START, "generate_sim")
    graph.add_conditional_edges("generate_sim", nodes.authored, {"ok": "generate_tests", "stop": "conclude"})
    graph.add_conditional_edges("generate_tests", nodes.authored, {"ok": "run_tests", "stop": "conclude"})
    graph.add_conditional_edges("run_tests", nodes.tested, {"audit": "audit", "fix": "route", "stop": "conclude"})
    graph.add_conditional_edges("route", nodes.routed, ["fix_code", "fix_tests"])
    graph.add_edge("fix_code", "run_tests")
    graph.add_edge("fix_tests", "run_tests")
    graph.add_conditional_edges("audit", nodes.audited, {"fix": "route", "stop": "conclude"})
    graph.add_edge("conclude", END)
    return graph
