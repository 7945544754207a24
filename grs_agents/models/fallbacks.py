"""Several models for one role: the next is asked where one fails after its retries."""

from typing import Any

from langchain_core.callbacks import CallbackManagerForLLMRun
from langchain_core.language_models.chat_models import BaseChatModel
from langchain_core.messages import BaseMessage
from langchain_core.outputs import ChatGeneration, ChatResult
from pydantic import PrivateAttr

from grs_agents.models.answer import (
    ASKED,
    ProviderFailure,
    ReplyProblem,
    require_complete_answer,
)
from grs_agents.models.retry import Retries, request_message

_FOR_GOOD = ("unreachable", "credentials", "quota", "not_found", "redirected")
"""What does not mend itself within a run: such a model is passed over from then on."""


class FallbackChatModel(BaseChatModel):
    """Asks its models in turn until one gives a usable reply; the reply's metadata tell which did, and who failed."""

    names: tuple[str, ...]
    models: tuple[BaseChatModel, ...]
    retries: tuple[Retries, ...]
    """For each of the models."""
    _given_up: set[int] = PrivateAttr(default_factory=set[int])

    @property
    def _llm_type(self) -> str:
        return "grs-fallbacks"

    def _generate(
        self,
        messages: list[BaseMessage],
        stop: list[str] | None = None,
        run_manager: CallbackManagerForLLMRun | None = None,
        **kwargs: Any,
    ) -> ChatResult:
        """The first usable reply. Raises as ``invoke_with_retries`` does: what went wrong with the last model."""
        numbers = range(len(self.models))
        failed: list[str] = []
        last: ProviderFailure | ReplyProblem = ProviderFailure("client_error", "there is no model to ask")
        for number in [one for one in numbers if one not in self._given_up] or numbers:
            try:
                message, answer = request_message(self.models[number], messages, self.retries[number])
                require_complete_answer(answer)
            except (ProviderFailure, ReplyProblem) as failure:
                last = failure
                failed.append(f"{self.names[number]}: {failure.message}")
                if failure.kind in _FOR_GOOD:
                    self._given_up.add(number)
                continue
            asked = {"model": self.names[number], "failed": failed}
            told = message.model_copy(update={"response_metadata": {**message.response_metadata, ASKED: asked}})
            return ChatResult(generations=[ChatGeneration(message=told)])
        if isinstance(last, ReplyProblem):
            raise ReplyProblem(last.kind, "; ".join(failed), last.remedy, last.answer) from last
        raise ProviderFailure(last.kind, "; ".join(failed), last.remedy) from last
