"""Every role is given exactly what its prompt declares, and all that its model is shown has a bounded length."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from grs_agents import content
from grs_agents.agents import Agents, JudgedPrograms, NoReply, TaskDefinition, read_prompt_template, roles
from grs_agents.config import Config
from grs_agents.trace import read_events
from tests.scripted import scripted

TASK = TaskDefinition.model_validate({"task-name": "t", "task-description": "<task>", "assets-used": ["a"]})
SCENE: dict[str, Any] = {"objects": [{"asset": "a", "name": "<scene>"}]}
JUDGED = JudgedPrograms(TASK, "<scene>", "<code>", "<tests>", "<test_results>", ["<history>"], (), "<explanation>")
ASKED: dict[str, Callable[[Agents], object]] = {
    "describe": lambda agents: roles.describe_segments(agents, [{"id": 1, "x": "<segments>"}], [1], "<pictures>", []),
    "match": lambda agents: roles.match_asset(agents, {"x": "<candidate>"}, [{"name": "<assets>"}], []),
    "task": lambda agents: roles.author_task(agents, SCENE, [{"name": "<fixtures>"}], []),
    "simulation": lambda agents: roles.author_simulation(agents, TASK, SCENE, "<api>", "<examples>", []),
    "tests": lambda agents: roles.author_tests(agents, TASK, "<code>", "<api>"),
    "route": lambda agents: roles.decide_what_to_fix(agents, JUDGED, ("fix_code", "fix_test")),
    "fix_code": lambda agents: roles.fix_code(agents, JUDGED, "<api>"),
    "fix_tests": lambda agents: roles.fix_tests(agents, JUDGED, "<api>"),
    "fix_task": lambda agents: roles.fix_task(agents, JUDGED, ["a"], "<fixtures>"),
    "judge": lambda agents: roles.judge_words(
        agents, "<words>", ["<other_texts>"], [{"x": "<objects>"}], ["<goals>"], []
    ),
}
MOST_CHARACTERS = 25_900
"""Of the fixed text of all these prompts together."""


@pytest.mark.parametrize("role", ASKED)
def test_a_role_shows_each_input_that_its_prompt_declares(role: str, tmp_path: Path) -> None:
    agents = scripted(tmp_path, ["I would rather not."], Config(reply_retries=0))
    assert isinstance(ASKED[role](agents), NoReply)
    [prompt] = [event for event in read_events(agents.log.path) if event.kind == "prompt"]
    shown = {"verdicts": "fix_code: change the simulation program"}
    for name in read_prompt_template(content.content_path("prompts", role)).inputs:
        assert shown.get(name, f"<{name}>") in prompt.text


def test_the_fixed_text_of_the_prompts_is_short() -> None:
    texts = [read_prompt_template(content.content_path("prompts", role)).text for role in ASKED]
    assert sum(map(len, texts)) <= MOST_CHARACTERS


def test_every_fixer_sees_what_it_judges() -> None:
    declared = {role: set(read_prompt_template(content.content_path("prompts", role)).inputs) for role in ASKED}
    judged = {"task", "scene", "code", "test_results", "history"}
    assert all(judged <= declared[role] for role in ("route", "fix_code", "fix_tests", "fix_task"))
    assert all("tests" in declared[role] for role in ("route", "fix_code", "fix_tests"))
