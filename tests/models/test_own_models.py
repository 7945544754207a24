"""A class of one's own, and several models for one role."""

from pathlib import Path
from typing import Any

import pytest
from langchain_core.messages import HumanMessage

from grs_agents.agents import roles
from grs_agents.agents.agent import Agents
from grs_agents.agents.roles import JudgedPrograms
from grs_agents.agents.types import TaskDefinition
from grs_agents.base.config.load import load_config
from grs_agents.base.config.schema import Config, ModelConfig
from grs_agents.base.errors import ConfigError, UnknownNameError
from grs_agents.base.trace.events import Note, Reply
from grs_agents.base.trace.log import EventLog, read_events
from grs_agents.models.answer import Answer, ProviderFailure
from grs_agents.models.call import invoke_with_retries
from grs_agents.models.factory import make_chat_model, make_retries
from tests.models.conftest import Scripted
from tests.needs import needs
from tests.scripted import scripted

OWN = "tests.scripted:ScriptedModel"
LOOPBACK_WITHOUT_SERVER = "http://127.0.0.1:9/v1"


def model(value: Any, *settings: str) -> ModelConfig:
    """The default model that ``models.default = value`` and further settings make."""
    return load_config(None, [f"models.default={value}", *settings], {}).config.models["default"]


def ask(config: ModelConfig) -> Answer:
    return invoke_with_retries(make_chat_model(config, seed=0), [HumanMessage("hi")], make_retries(config))


def test_a_class_by_its_dotted_path_is_made_with_its_arguments() -> None:
    built = make_chat_model(model(OWN, "models.arguments.replies=['yes']"), seed=0)
    assert type(built).__name__ == "ScriptedModel" and built.model_dump()["replies"] == ["yes"]


@pytest.mark.parametrize(
    ("name", "settings", "told"),
    [
        (OWN, [], "replies"),
        ("tests.scripted:Missing", [], "Missing"),
        ("tests.scripted:say", ["models.arguments.text='x'"], "no LangChain chat model"),
        (OWN, ["models.arguments.replies=[]", "models.temperature=1"], "temperature is not passed on"),
    ],
)
def test_a_class_that_cannot_serve_is_the_users_affair(name: str, settings: list[str], told: str) -> None:
    with pytest.raises(ConfigError, match=told):
        make_chat_model(model(name, *settings), seed=0)


def test_a_module_that_does_not_exist_is_an_unknown_name() -> None:
    with pytest.raises(UnknownNameError, match=r"package\.module:Class"):
        make_chat_model(model("no_such_module_here:Model"), seed=0)


@pytest.mark.parametrize("argument", ["api_key='s3cret'", "headers={Authorization='s3cret'}", "session_token='s3cret'"])
def test_a_key_among_the_arguments_is_refused_and_not_repeated(argument: str) -> None:
    with pytest.raises(ConfigError, match="key_variable") as caught:
        model("openai:any", f"models.arguments.{argument}")
    assert "s3cret" not in str(caught.value)


@needs("langchain_openai")
def test_an_argument_that_grs_sets_itself_is_refused() -> None:
    with pytest.raises(ConfigError, match="max_retries"):
        config = model("openai:any", f"models.base_url={LOOPBACK_WITHOUT_SERVER}", "models.arguments.max_retries=9")
        make_chat_model(config, seed=0)


def test_a_list_is_a_model_and_its_fallbacks_which_share_its_time_but_not_its_endpoint() -> None:
    config = model(
        '["openai:a", "ollama:b", {model = "offline", timeout = 5}]', "models.base_url=http://a", "models.timeout=9"
    )
    assert (config.model, config.base_url) == ("openai:a", "http://a")
    assert [(item.model, item.base_url, item.timeout) for item in config.fallbacks] == [
        ("ollama:b", None, 9),
        ("offline", None, 5),
    ]
    assert ModelConfig.model_validate_json(config.model_dump_json()) == config


@needs("langchain_openai")
def test_the_next_model_is_asked_where_one_fails_for_good(server: tuple[Scripted, str]) -> None:
    script, url = server
    script.say(401, {"error": {"message": "wrong key", "type": "x", "code": None}})
    config = model('["openai:a", "offline"]', f"models.base_url={url}")
    built = make_chat_model(config, seed=0)
    for _ in range(2):
        answer = invoke_with_retries(built, [HumanMessage("hi")], make_retries(config))
        assert answer.model == "offline" and "# Role:" in answer.text
    assert len(script.requests) == 1


@needs("langchain_openai")
def test_a_refusal_is_passed_on_to_the_next_but_that_model_is_asked_again(server: tuple[Scripted, str]) -> None:
    script, url = server
    script.complete(None, "stop", refusal="I cannot")
    script.complete("hello")
    built = make_chat_model(config := model('["openai:a", "offline"]', f"models.base_url={url}"), seed=0)
    answers = [invoke_with_retries(built, [HumanMessage("hi")], make_retries(config)) for _ in range(2)]
    assert [answer.model for answer in answers] == ["offline", "openai:a"]
    assert "I cannot" in answers[0].failed[0]


@needs("langchain_openai")
def test_where_all_fail_each_is_told(server: tuple[Scripted, str]) -> None:
    script, url = server
    script.say(404, {"error": {"message": "none", "type": "x", "code": None}})
    tables = ", ".join(f'{{model = "openai:{name}", base_url = "{url}"}}' for name in "ab")
    with pytest.raises(ProviderFailure, match=r"openai:a: .* answers 404.*openai:b: .* answers 404") as caught:
        ask(model(f'["openai:z", {tables}]', f"models.base_url={url}"))
    assert caught.value.kind == "not_found" and len(script.requests) == 3


@needs("langchain_openai")
def test_the_trace_says_who_answered(server: tuple[Scripted, str], tmp_path: Path) -> None:
    script, url = server
    script.say(401, {"error": {"message": "wrong key", "type": "x", "code": None}})
    config = Config(models={"default": model('["openai:a", "offline"]', f"models.base_url={url}")})
    agents = Agents(config, EventLog(tmp_path / "events.jsonl"), tmp_path)
    task = TaskDefinition.model_validate({"task-name": "t", "task-description": "d", "assets-used": ["a"]})
    roles.decide_what_to_fix(agents, JudgedPrograms(task, "{}", "", "", "failed: 0 of 1", []), ("fix_code", "fix_test"))
    events = read_events(agents.log.path)
    assert {event.model for event in events if isinstance(event, Reply)} == {"offline"}
    [note] = [event for event in events if isinstance(event, Note)]
    assert note.level == "warning" and note.text.startswith("offline is asked in place of openai:a: ")


def test_a_server_that_cannot_be_reached_ends_the_question_at_once(tmp_path: Path) -> None:
    agents = scripted(tmp_path, [ProviderFailure("unreachable", "nobody listens"), "```\nfix_code\n```"])
    task = TaskDefinition.model_validate({"task-name": "t", "task-description": "d", "assets-used": ["a"]})
    with pytest.raises(ProviderFailure, match="nobody listens"):
        roles.decide_what_to_fix(
            agents, JudgedPrograms(task, "{}", "", "", "failed: 0 of 1", []), ("fix_code", "fix_test")
        )
    assert len(agents.script.asked) == 1
