"""An author that calls tools before it hands its program in."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from grs_agents import api
from grs_agents.agents.agent import Agents
from grs_agents.base.config.schema import ModelConfig
from grs_agents.base.errors import ConfigError
from grs_agents.base.trace.events import ProgramVersion, ToolCall
from grs_agents.base.trace.log import read_events
from grs_agents.graph.authoring import generate_sim_with_tools
from grs_agents.graph.services import Services
from grs_agents.graph.state import RunState
from grs_agents.views.common.event_steps import group_events_into_steps
from grs_agents.views.common.step_text import iter_step_sections
from tests.chat_server import Answer, Json, chat_server, completion
from tests.graph.conftest import SIMULATION, Make, fenced, kinds, run, with_

USAGE = {"prompt_tokens": 10, "completion_tokens": 5, "total_tokens": 15}


def call(name: str, /, **arguments: Any) -> Json:
    """A message of the OpenAI protocol that calls one tool."""
    function = {"name": name, "arguments": json.dumps(arguments)}
    return {"content": None, "tool_calls": [{"id": "one", "type": "function", "function": function}]}


def with_own_models(services: Services) -> Services:
    """The services with the models that the configuration names."""
    return replace(services, agents=Agents(services.config, services.log, services.folder))


def author(state: RunState, make_services: Make, answers: list[Json], **settings: Any) -> tuple[Any, Any, list[Json]]:
    """The update of an author whose model gives ``answers``, the services and what the model was sent."""
    asked: list[Json] = []

    def answer(body: Json, _: str) -> Answer:
        asked.append(body)
        message = answers[min(len(asked), len(answers)) - 1]
        finish = "tool_calls" if "tool_calls" in message else "stop"
        return 200, {}, json.dumps(completion(message, USAGE, finish)).encode()

    with chat_server(answer) as url:
        model = ModelConfig(model="openai:any", base_url=url)
        services = with_own_models(make_services(models={"default": model}, **settings))
        update = run(generate_sim_with_tools, with_(state, simulation=..., simulation_version=...), services)
    return update, services, asked


def test_a_model_checks_and_measures_and_hands_in(state: RunState, make_services: Make) -> None:
    answers = [
        call("measure", first="red_block_1", second="blue_block_1"),
        call("check", program=SIMULATION),
        {"content": fenced(SIMULATION)},
    ]
    update, services, asked = author(state, make_services, answers)
    assert update["simulation"].strip() == SIMULATION.strip()
    assert {tool["function"]["name"] for tool in asked[0]["tools"]} == {"check", "describe_asset", "measure", "render"}
    measured, checked = kinds(services, "tool_call")
    assert (measured.tool, checked.tool) == ("measure", "check")
    assert measured.result.startswith("0.304 m")
    assert "== audit\naccepted" in checked.result
    assert asked[-1]["messages"][-1]["content"] == checked.result
    assert len(kinds(services, "reply")) == 3


def test_an_author_looks_at_assets_and_at_its_draft(state: RunState, make_services: Make) -> None:
    answers = [
        call("render"),
        call("describe_asset", name="bowl/bowl.urdf"),
        call("check", program=SIMULATION),
        call("render"),
        {"content": fenced(SIMULATION)},
    ]
    _, services, asked = author(state, make_services, answers)
    early, described, _, drawn = kinds(services, "tool_call")
    assert "check a draft" in early.result and json.loads(described.result)["name"] == "bowl/bowl.urdf"
    assert drawn.ok and drawn.result == "(a picture)"
    assert (services.folder / "instances" / "author.png").is_file()
    shown = json.dumps(asked[-1]["messages"][-1])
    assert "image" in shown and len(shown) > 5_000
    for tool in asked[0]["tools"]:
        for argument in tool["function"]["parameters"]["properties"].values():
            assert argument["description"]


@pytest.mark.parametrize(
    ("called", "told"),
    [
        (call("measure", first={"name": "red_block_1"}), "author.steps (now 2)"),
        (call("nothing"), "called what is no tool"),
    ],
)
def test_an_author_that_calls_in_vain_is_ended(state: RunState, make_services: Make, called: Json, told: str) -> None:
    update, services, _ = author(state, make_services, [called], author={"steps": 2})
    assert told in update["problem"]
    assert not any(event.ok for event in kinds(services, "tool_call"))


def test_the_budget_ends_a_model_that_only_calls(state: RunState, make_services: Make) -> None:
    answers = [call("measure", first="red_block_1")]
    update, services, _ = author(state, make_services, answers, author={"steps": 2})
    assert "author.steps (now 2)" in update["problem"]
    assert [event.ok for event in kinds(services, "tool_call")] == [True, True, False, False, False]


def test_the_offline_model_checks_its_draft_and_is_accepted(known_scene: Path, tmp_path: Path) -> None:
    ended = api.run(known_scene, out=tmp_path / "run", graph="tool_author", audit={"seeds": 1})
    events = read_events(ended.folder / "events.jsonl")
    [checked] = [event for event in events if isinstance(event, ToolCall)]
    assert ended.status == "accepted"
    [version] = [event for event in events if isinstance(event, ProgramVersion) and event.program == "simulation"]
    assert (ended.folder / version.path).read_text().strip() == checked.arguments["program"].strip()
    steps = {step.node: step for step in group_events_into_steps(events)}
    assert "check: accepted" in steps["generate_sim"].details_as_text
    assert any("calls check" in section.heading for section in iter_step_sections(steps["generate_sim"]))


def test_a_model_without_tool_calling_is_refused(state: RunState, make_services: Make) -> None:
    services = make_services(fenced(SIMULATION), graph="tool_author")
    with pytest.raises(ConfigError, match="role simulation cannot call tools, which graph 'tool_author'"):
        run(generate_sim_with_tools, state, services)
