"""The offline chat model as a LangChain model: the standard tests, determinism, images, help."""

from typing import Any

from langchain_core.language_models.chat_models import BaseChatModel
from langchain_core.messages import AIMessage, HumanMessage
from langchain_tests.unit_tests import ChatModelUnitTests

from grs_agents.models.offline.chat import OfflineChatModel
from tests.models.conftest import render, rich_scene
from tests.models.roles import as_text


class TestStandard(ChatModelUnitTests):
    """LangChain's own tests for any chat model."""

    @property
    def chat_model_class(self) -> type[BaseChatModel]:
        return OfflineChatModel

    @property
    def chat_model_params(self) -> dict[str, Any]:
        return {}


def test_prompt_and_seed_decide_the_reply() -> None:
    prompt = render("task", {"scene": as_text(rich_scene()), "fixtures": "", "sides": ""})
    first, second = (OfflineChatModel(seed=3).invoke(prompt) for _ in range(2))
    assert first.text == second.text
    assert len({OfflineChatModel(seed=seed).invoke(prompt).text for seed in range(8)}) > 3


def test_usage_and_finish_reason_are_told() -> None:
    answer = OfflineChatModel().invoke(render("task", {"scene": as_text(rich_scene()), "fixtures": "", "sides": ""}))
    assert isinstance(answer, AIMessage)
    assert answer.usage_metadata is not None
    assert answer.usage_metadata["total_tokens"] == sum(
        answer.usage_metadata[kind] for kind in ("input_tokens", "output_tokens")
    )
    assert answer.response_metadata["finish_reason"] == "stop"


def test_a_stream_adds_up_to_the_reply() -> None:
    prompt = render("task", {"scene": as_text(rich_scene()), "fixtures": "", "sides": ""})
    model = OfflineChatModel(seed=1)
    assert "".join(str(chunk.text) for chunk in model.stream(prompt)) == model.invoke(prompt).text


def test_after_a_complaint_the_prompt_is_answered_again() -> None:
    prompt = render("task", {"scene": as_text(rich_scene()), "fixtures": "", "sides": ""})
    model = OfflineChatModel()
    again = model.invoke([HumanMessage(prompt), AIMessage("nonsense"), HumanMessage("Reply again.")])
    assert again.text == model.invoke(prompt).text


def test_a_prompt_without_a_role_gets_help() -> None:
    assert "# Role:" in OfflineChatModel().invoke("hello").text
