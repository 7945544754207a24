"""Two authors write side by side; the better program goes on."""

from typing import Any, cast

import pytest
from langgraph.graph import START

from grs_agents.base.trace.events import NodeEnded, NodeStarted, Note
from grs_agents.base.trace.log import read_events
from grs_agents.graph.authoring import choose_draft
from grs_agents.graph.judging import conclude_with_best_version
from grs_agents.graph.perceive import hide_image
from grs_agents.graph.state import RunState
from grs_agents.graph.topology import add_competing_authors, empty_graph
from grs_agents.views.common.event_steps import Step, group_events_into_steps
from tests.graph.conftest import SIMULATION, Make, fenced, kinds, run, with_

OFF_TARGET = SIMULATION.replace("(*target, 0.02)", "(*start, 0.02)")
BROKEN = SIMULATION.replace("np.ones((1, 1))", "np.ones((1, 1)) / 0 * nothing")


def test_two_authors_compete_in_a_graph(state: RunState, make_services: Make) -> None:
    services = make_services(
        '```json\n{"task-name": "move", "task-description": "move the red and the blue block", '
        '"assets-used": ["block/red_block.urdf", "block/blue_block.urdf"]}\n```',
        fenced(SIMULATION),
        fenced(BROKEN),
    )
    graph = empty_graph()
    graph.add_edge(START, "generate_task")
    add_competing_authors(graph, "generate_task", then="chosen")
    graph.add_node("chosen", hide_image)
    graph.add_node("conclude", conclude_with_best_version)
    begin = with_(state, task=..., simulation=..., simulation_version=..., tests=..., tests_version=...)
    end = cast(dict[str, Any], graph.compile().invoke(begin, context=services))
    assert {draft.author for draft in end["drafts"]} == {"simulation", "rival"}
    assert end["simulation"].strip() == SIMULATION.strip()
    assert (services.folder / "simulation.py").read_text() == end["simulation"]
    assert {prompt.role for prompt in kinds(services, "prompt")} == {"task", "simulation", "rival"}
    steps = {step.node: step for step in group_events_into_steps(read_events(services.log.path))}
    assert all(step.status == "done" for step in steps.values())
    assert [reply.role for reply in steps["draft_rival"].model_replies] == ["rival"]
    assert [reply.role for reply in steps["draft_sim"].model_replies] == ["simulation"]


@pytest.mark.parametrize("order", [("simulation", "rival"), ("rival", "simulation")])
def test_the_program_that_holds_more_checks_is_kept(
    order: tuple[str, str], state: RunState, make_services: Make
) -> None:
    services = make_services()
    worse, better = ({"author": order[0], "source": OFF_TARGET}, {"author": order[1], "source": SIMULATION})
    update = run(choose_draft, with_(state, drafts=[worse, better], simulation=...), services)
    assert update["simulation"] == SIMULATION
    [version] = kinds(services, "program_version")
    assert version.author_role == order[1]
    assert len([note for note in kinds(services, "note") if "checks hold" in note.text]) == 2


def test_without_a_program_the_run_says_why(state: RunState, make_services: Make) -> None:
    drafts = [{"author": author, "problem": f"{author} is silent"} for author in ("simulation", "rival")]
    update = run(choose_draft, with_(state, drafts=drafts), make_services())
    assert update == {"problem": "simulation is silent; rival is silent"}


def test_events_of_nodes_side_by_side_are_told_apart() -> None:
    events = [
        NodeStarted(node="a", sequence=0),
        NodeStarted(node="b", sequence=1),
        Note(level="warning", text="of a", step=0, sequence=2),
        Note(level="warning", text="of b", step=1, sequence=3),
        NodeEnded(node="a", seconds=1.0, step=0, sequence=4),
        NodeEnded(node="b", seconds=2.0, step=1, sequence=5),
    ]
    rows: list[Step] = group_events_into_steps(list(events))
    assert [(row.node, row.status, row.details_as_text, row.seconds) for row in rows] == [
        ("a", "done", "of a", 1.0),
        ("b", "done", "of b", 2.0),
    ]
