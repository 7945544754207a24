"""Several models for a role: the next is asked if a model fails after its retries."""

from typing import Any

from langchain_core.callbacks import CallbackManagerForLLMRun
from langchain_core.language_models.chat_models import BaseChatModel
from langchain_core.messages import BaseMessage
from langchain_core.outputs import ChatGeneration, ChatResult
from pydantic import PrivateAttr

from grs_agents.models.answer import ASKED, ProviderFailure, ReplyProblem, require_complete_answer
from grs_agents.models.call import Retries, request_message

_FOR_GOOD = ("unreachable", "credentials", "quota", "not_found", "redirected")
"""Failures that last for a run: such a model is skipped from then on."""


class FallbackChatModel(BaseChatModel):
    """Asks its models in turn until a reply is usable; the reply's metadata name that model and the failed models."""

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
        """The first usable reply. Raises as ``invoke_with_retries`` does, for the last model."""
        numbers = range(len(self.models))
        failed: list[str] = []
        last: ProviderFailure | ReplyProblem = ProviderFailure("client_error", "there is no model to ask")
        for number in [number for number in numbers if number not in self._given_up] or numbers:
            try:
                message, answer = request_message(self.models[number], messages, self.retries[number])
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
