"""The nodes of every graph: state in, update out."""

from grs_agents.nodes.authoring import fix_code, fix_tests, generate_sim, generate_task, generate_tests
from grs_agents.nodes.comprehension import (
    describe,
    find_table,
    hide_image,
    match,
    read,
    register,
    registered,
    segment,
    settle,
)
from grs_agents.nodes.judging import audit, audited, authored, conclude, route, routed, run_tests, tested
from grs_agents.nodes.segments import RunGraph, author, empty_graph, fix_loop, judge, perceive
from grs_agents.nodes.services import Services

__all__ = [
    "RunGraph",
    "Services",
    "audit",
    "audited",
    "author",
    "authored",
    "conclude",
    "describe",
    "empty_graph",
    "find_table",
    "fix_code",
    "fix_loop",
    "fix_tests",
    "generate_sim",
    "generate_task",
    "generate_tests",
    "hide_image",
    "judge",
    "match",
    "perceive",
    "read",
    "register",
    "registered",
    "route",
    "routed",
    "run_tests",
    "segment",
    "settle",
    "tested",
]
