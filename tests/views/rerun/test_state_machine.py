"""The state machine as a picture."""

from itertools import pairwise

import pytest

from grs_agents.views.rerun import state_machine


@pytest.mark.parametrize("graph", ["grs", "router", "scene", "no_router", "anything"])
def test_nodes_stand_apart_and_edges_join_them(graph: str) -> None:
    nodes = (*state_machine.expected_nodes(graph), "mine", "yours")
    spots = state_machine.node_positions(nodes)
    assert set(spots) == set(nodes)
    assert len(set(spots.values())) == len(nodes)
    assert {end for edge in state_machine.edges(nodes) for end in edge} <= set(nodes)


def test_the_cards_machine_is_whole() -> None:
    nodes = state_machine.expected_nodes("router")
    assert {"generate_sim", "generate_tests", "run_tests", "route", "fix_code", "fix_tests", "audit"} < set(nodes)
    assert ("route", "fix_code") in state_machine.edges(nodes)
    assert "match" not in nodes


def test_perception_is_a_chain_with_a_second_pass() -> None:
    nodes = ("read", "find_table", "segment", "describe", "match", "register", "settle")
    assert set(state_machine.edges(nodes)) == {*pairwise(nodes), ("register", "describe")}


def test_colours_are_stable() -> None:
    assert state_machine.color("route") != state_machine.color("audit")
    assert state_machine.color("mine") == state_machine.color("mine")
