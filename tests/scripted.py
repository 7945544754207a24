"""A chat model that gives prepared replies, and an `Agents` whose every role it serves."""

from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from langchain_core.callbacks import CallbackManagerForLLMRun
from langchain_core.language_models.chat_models import BaseChatModel
from langchain_core.messages import AIMessage, BaseMessage
from langchain_core.outputs import ChatGeneration, ChatResult
from pydantic import Field

from grs_agents.agents.agent import Agents
from grs_agents.base.config.schema import Config
from grs_agents.base.trace.log import EventLog


class ScriptedModel(BaseChatModel):
    """Gives its replies one by one, and raises those that are exceptions.

    Attributes:
        replies: those not given yet, each an `AIMessage` or an exception.
        asked: the messages of each call, oldest call first.
    """

    replies: list[Any]
    asked: list[list[BaseMessage]] = Field(default_factory=list[list[BaseMessage]])

    @property
    def _llm_type(self) -> str:
        return "scripted"

    def _generate(
        self,
        messages: list[BaseMessage],
        stop: list[str] | None = None,
        run_manager: CallbackManagerForLLMRun | None = None,
        **kwargs: Any,
    ) -> ChatResult:
        self.asked.append(list(messages))
        reply = self.replies.pop(0)
        if isinstance(reply, Exception):
            raise reply
        return ChatResult(generations=[ChatGeneration(message=reply)])


class StubbornModel(BaseChatModel):
    """Gives each role the same reply whenever it is asked.

    Attributes:
        replies: by role.
    """

    replies: dict[str, str]

    @property
    def _llm_type(self) -> str:
        return "stubborn"

    def _generate(
        self,
        messages: list[BaseMessage],
        stop: list[str] | None = None,
        run_manager: CallbackManagerForLLMRun | None = None,
        **kwargs: Any,
    ) -> ChatResult:
        text = str(messages[0].text)
        role = text[text.index("# Role: ") + 8 :].partition("\n")[0]
        return ChatResult(generations=[ChatGeneration(message=say(self.replies[role]))])


@dataclass
class ScriptedAgents(Agents):
    """Agents of which every role is served by `script`."""

    script: ScriptedModel = field(default_factory=lambda: ScriptedModel(replies=[]))

    def chat_model_for_role(self, role: str) -> BaseChatModel:
        """The scripted model; once it has nothing left to say, the judge is the one that is configured."""
        return super().chat_model_for_role(role) if role == "judge" and not self.script.replies else self.script


@dataclass
class StubbornAgents(Agents):
    """Agents of which every role is served by `stubborn`."""

    stubborn: StubbornModel = field(default_factory=lambda: StubbornModel(replies={}))

    def chat_model_for_role(self, role: str) -> BaseChatModel:
        """The stubborn model, where it has a reply for ``role``; else the one that is configured."""
        return self.stubborn if role in self.stubborn.replies else super().chat_model_for_role(role)


def say(text: str, finish: str = "stop") -> AIMessage:
    """A whole reply of 11 input and 5 output tokens."""
    usage = {"input_tokens": 11, "output_tokens": 5, "total_tokens": 16}
    return AIMessage.model_validate(
        {"content": text, "usage_metadata": usage, "response_metadata": {"finish_reason": finish}}
    )


def scripted(
    folder: Path, replies: Iterable[str | AIMessage | Exception], config: Config | None = None
) -> ScriptedAgents:
    """Agents that log to ``folder`` and get ``replies``; a text is a whole reply."""
    script = ScriptedModel(replies=[say(reply) if isinstance(reply, str) else reply for reply in replies])
    return ScriptedAgents(config or Config(), EventLog(folder / "events.jsonl"), folder, script=script)
