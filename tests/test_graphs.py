"""Every graph: it builds, ends, is short, and is what its name says."""

import pytest

from grs_agents.base import content

GRAPHS = content.content_names("graphs")


def drawn(name: str) -> tuple[set[str], set[tuple[str, str]]]:
    graph = content.load_module("graphs", name).build().compile().get_graph()
    return set(graph.nodes) - {"__start__", "__end__"}, {(edge.source, edge.target) for edge in graph.edges}


def test_the_graphs_of_the_paper_are_there() -> None:
    assert {"grs", "router", "scene", "no_router", "no_fix", "llm_only"} <= set(GRAPHS)


@pytest.mark.parametrize("name", GRAPHS)
def test_every_graph_is_one_short_topology(name: str) -> None:
    assert len(content.content_path("graphs", name).read_text().splitlines()) < 100
    assert content.load_module("graphs", name).__doc__


@pytest.mark.parametrize("name", GRAPHS)
def test_every_node_leads_to_the_end(name: str) -> None:
    names, edges = drawn(name)
    reached = {"__end__"}
    while True:
        more = {source for source, target in edges if target in reached} - reached
        if not more:
            break
        reached |= more
    assert names <= reached


def test_the_router_loops_until_the_audit() -> None:
    _, edges = drawn("router")
    assert {("run_tests", "route"), ("route", "fix_code"), ("route", "fix_tests"), ("audit", "route")} <= edges
    assert {("fix_code", "run_tests"), ("fix_tests", "run_tests"), ("run_tests", "audit")} <= edges


def test_the_whole_graph_alone_may_revise_its_task() -> None:
    assert [name for name in GRAPHS if "fix_task" in drawn(name)[0]] == ["grs", "grs_review", "tool_author"]
    _, edges = drawn("grs")
    assert {("route", "fix_task"), ("fix_task", "generate_sim"), ("fix_task", "run_tests")} <= edges


def test_a_person_is_asked_for_the_edits_of_a_scene_in_the_graph_with_review_alone() -> None:
    assert [name for name in GRAPHS if "review" in drawn(name)[0]] == ["grs_review"]
    _, edges = drawn("grs_review")
    assert {("settle", "review"), ("read", "review"), ("review", "edit"), ("edit", "generate_task")} <= edges
    assert {("settle", "edit"), ("read", "edit"), ("edit", "generate_task")} <= drawn("grs")[1]


def test_two_authors_work_side_by_side() -> None:
    names, edges = drawn("best_of")
    assert "generate_sim" not in names
    for draft in ("draft_sim", "draft_rival"):
        assert {("generate_task", draft), (draft, "choose_draft")} <= edges


def test_the_ablations_leave_out_what_they_are_named_for() -> None:
    assert {"route", "fix_tests"}.isdisjoint(drawn("no_router")[0])
    assert {"run_tests", "generate_tests", "fix_code"}.isdisjoint(drawn("no_fix")[0])
    assert "hide_image" in drawn("llm_only")[0]
