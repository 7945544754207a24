"""Chat models that ask others: several models for a role, of which the next is asked if a model fails after its
retries."""

from collections.abc import Mapping, Sequence
from typing import Any

from langchain_core.callbacks import CallbackManagerForLLMRun, Callbacks
from langchain_core.language_models import LanguageModelInput
from langchain_core.language_models.chat_models import BaseChatModel
from langchain_core.messages import BaseMessage, HumanMessage
from langchain_core.outputs import ChatGeneration, ChatResult, LLMResult
from langchain_core.prompt_values import PromptValue
from langchain_core.runnables import Runnable
from pydantic import BaseModel, PrivateAttr

from grs_agents.models.answer import ASKED, ProviderFailure, ReplyProblem, require_complete_answer
from grs_agents.models.call import Retries, SchemaSupport, request_message, request_structured_message

_FOR_GOOD = ("unreachable", "credentials", "quota", "not_found", "redirected")
"""Failures that last for a run: such a model is skipped from then on."""


class DelegatingChatModel(BaseChatModel):
    """A chat model whose calls are calls of other models, which alone report to callbacks: nothing counts twice."""

    def generate_prompt(
        self,
        prompts: list[PromptValue],
        stop: list[str] | None = None,
        callbacks: Callbacks | list[Callbacks] | None = None,
        **kwargs: Any,
    ) -> LLMResult:
        """Call the base class without callbacks."""
        return super().generate_prompt(prompts, stop, None, **kwargs)


class FallbackChatModel(DelegatingChatModel):
    """Asks its models in turn until a reply is usable; the reply's metadata name that model and the failed models."""

    names: tuple[str, ...]
    models: tuple[BaseChatModel, ...]
    # for each of the models: limits of its tries; pictures are sent to it; it may be sent a JSON schema
    retries: tuple[Retries, ...]
    pictures: tuple[bool, ...]
    structured: tuple[bool, ...]
    _given_up: set[int] = PrivateAttr(default_factory=set[int])
    _supports: dict[int, SchemaSupport] = PrivateAttr(default_factory=dict[int, SchemaSupport])

    @property
    def _llm_type(self) -> str:
        return "grs-fallbacks"

    def with_structured_output(
        self, schema: dict[str, Any] | type, *, include_raw: bool = False, **kwargs: Any
    ) -> Runnable[LanguageModelInput, dict[str, Any] | BaseModel]:
        """Send the schema to each model that supports it; the output is the message, since others reply with text."""
        return self.bind(schema=schema)

    def _generate(
        self,
        messages: list[BaseMessage],
        stop: list[str] | None = None,
        run_manager: CallbackManagerForLLMRun | None = None,
        **kwargs: Any,
    ) -> ChatResult:
        """The first usable reply. Raises as ``invoke_with_retries`` does, for the last model."""
        numbers = range(len(self.models))
        failed: list[str] = []
        last: ProviderFailure | ReplyProblem = ProviderFailure("client_error", "there is no model to ask")
        schema: Mapping[str, Any] | None = kwargs.get("schema")
        for number in [number for number in numbers if number not in self._given_up] or numbers:
            model, retries = self.models[number], self.retries[number]
            sent = messages if self.pictures[number] else remove_pictures(messages)
            try:
                if schema is None or not self.structured[number]:
                    message, answer = request_message(model, sent, retries)
                else:
                    support = self._supports.setdefault(number, SchemaSupport())
                    message, answer = request_structured_message(model, sent, retries, schema, support)
                require_complete_answer(answer)
            except (ProviderFailure, ReplyProblem) as failure:
                last = failure
                failed.append(f"{self.names[number]}: {failure.message}")
                if failure.kind in _FOR_GOOD:
                    self._given_up.add(number)
                continue
            fallback = {"model": self.names[number], "failed": failed}
            metadata = {**message.response_metadata, ASKED: fallback}
            reply = message.model_copy(update={"response_metadata": metadata})
            return ChatResult(generations=[ChatGeneration(message=reply)])
        if isinstance(last, ReplyProblem):
            raise ReplyProblem(last.kind, "; ".join(failed), last.remedy, last.answer) from last
        raise ProviderFailure(last.kind, "; ".join(failed), last.remedy) from last


def remove_pictures(messages: Sequence[BaseMessage]) -> list[BaseMessage]:
    """The messages with the text of each user message alone."""
    return [HumanMessage(str(item.text)) if isinstance(item, HumanMessage) else item for item in messages]
