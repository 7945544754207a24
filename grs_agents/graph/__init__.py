"""The nodes of a run's graph, which take its state and return an update, and the segments that graphs share."""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from grs_agents.graph.authoring import generate_sim as generate_sim
    from grs_agents.graph.authoring import generate_task as generate_task
    from grs_agents.graph.authoring import generate_tests as generate_tests
    from grs_agents.graph.fixing import fix_code as fix_code
    from grs_agents.graph.fixing import fix_task as fix_task
    from grs_agents.graph.fixing import fix_tests as fix_tests
    from grs_agents.graph.judging import audit_task as audit_task
    from grs_agents.graph.judging import conclude_with_best_version as conclude_with_best_version
    from grs_agents.graph.judging import decide_what_to_fix as decide_what_to_fix
    from grs_agents.graph.judging import run_tests as run_tests
    from grs_agents.graph.perceive import describe_candidates as describe_candidates
    from grs_agents.graph.perceive import find_table as find_table
    from grs_agents.graph.perceive import hide_image as hide_image
    from grs_agents.graph.perceive import match_candidates_to_assets as match_candidates_to_assets
    from grs_agents.graph.perceive import read_photo_into_run as read_photo_into_run
    from grs_agents.graph.perceive import register_assets_in_photo as register_assets_in_photo
    from grs_agents.graph.perceive import segment_photo as segment_photo
    from grs_agents.graph.perceive import settle_objects as settle_objects
    from grs_agents.graph.services import Services as Services
    from grs_agents.graph.topology import RunGraph as RunGraph
    from grs_agents.graph.topology import add_authors as add_authors
    from grs_agents.graph.topology import add_competing_authors as add_competing_authors
    from grs_agents.graph.topology import add_fix_loop as add_fix_loop
    from grs_agents.graph.topology import add_judging as add_judging
    from grs_agents.graph.topology import add_perception as add_perception
    from grs_agents.graph.topology import add_tool_author as add_tool_author
    from grs_agents.graph.topology import empty_graph as empty_graph

_HOMES = {
    "RunGraph": "topology",
    "Services": "services",
    "add_authors": "topology",
    "add_competing_authors": "topology",
    "add_fix_loop": "topology",
    "add_judging": "topology",
    "add_perception": "topology",
    "add_tool_author": "topology",
    "audit_task": "judging",
    "conclude_with_best_version": "judging",
    "decide_what_to_fix": "judging",
    "describe_candidates": "perceive",
    "empty_graph": "topology",
    "find_table": "perceive",
    "fix_code": "fixing",
    "fix_task": "fixing",
    "fix_tests": "fixing",
    "generate_sim": "authoring",
    "generate_task": "authoring",
    "generate_tests": "authoring",
    "hide_image": "perceive",
    "match_candidates_to_assets": "perceive",
    "read_photo_into_run": "perceive",
    "register_assets_in_photo": "perceive",
    "run_tests": "judging",
    "segment_photo": "perceive",
    "settle_objects": "perceive",
}
"""The module of each export: `grs check` audits with modules of this package, and asks no model."""


def __getattr__(name: str) -> Any:
    """Import an export when it is first used."""
    if name in _HOMES:
        return getattr(import_module(f"{__name__}.{_HOMES[name]}"), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
