"""The state machine as a picture."""

import pytest

from grs_agents.base import content
from grs_agents.views.rerun import state_machine_view


@pytest.mark.parametrize("graph", ["grs", "router", "scene", "no_router", "llm_only"])
def test_nodes_stand_apart(graph: str) -> None:
    nodes = (*content.load_module("graphs", graph).build().nodes, state_machine_view.END, "mine", "yours")
    spots = state_machine_view.node_positions(nodes)
    assert set(spots) == set(nodes)
    assert len(set(spots.values())) == len(nodes)


def test_colours_are_stable() -> None:
    assert state_machine_view.node_color("route") != state_machine_view.node_color("audit")
    assert state_machine_view.node_color("mine") == state_machine_view.node_color("mine")
