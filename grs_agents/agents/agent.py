"""An agent: a prompt, a chat model and a strict parser; every exchange is an event."""

import base64
import math
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TypeVar, cast
from uuid import uuid4

import cv2
from langchain_core.language_models.chat_models import BaseChatModel
from langchain_core.messages import AIMessage, BaseMessage, HumanMessage

from grs_agents import content
from grs_agents.agents.prompt import render
from grs_agents.agents.reply import ReplyError
from grs_agents.agents.types import NoReply
from grs_agents.config import Config
from grs_agents.foreign import member
from grs_agents.foreign.pictures import read_picture
from grs_agents.models import ReplyProblem, chat_model, invoke
from grs_agents.trace import EventLog, Prompt, Reply

Answer = TypeVar("Answer")
IMAGE_SIDE = 1024
"""Longer sides are scaled down to this many pixels before a picture is sent."""


@dataclass
class Agents:
    """The models by role, what they may cost, and the log of all they were asked.

    Attributes:
        config: names the model, the prompt and the retries of each role.
        log: where each prompt and reply is recorded.
        folder: the run folder; images are given relative to it.
    """

    config: Config
    log: EventLog
    folder: Path
    _models: dict[str, BaseChatModel] = field(default_factory=dict[str, BaseChatModel])

    def model(self, role: str) -> BaseChatModel:
        """The chat model that serves ``role``, made once."""
        spec = self.config.model_for(role)
        key = spec.model_dump_json()
        if key not in self._models:
            self._models[key] = chat_model(spec, self.config.seed)
        return self._models[key]

    def ask(
        self,
        role: str,
        values: Mapping[str, str],
        parse: Callable[[str], Answer],
        images: Sequence[str] = (),
    ) -> Answer | NoReply:
        """Ask ``role`` and parse its reply; a reply that does not parse is asked for again with the error.

        Args:
            role: one of the agent roles.
            values: the prompt's variables.
            parse: raises ``ReplyError`` on a reply of the wrong form.
            images: picture files relative to the run folder, sent before the text in this order.

        Raises:
            GrsError: the model cannot be reached, or refuses the request for good.
        """
        file = content.path("prompts", getattr(self.config.prompts, role))
        text = render(file, values)
        blocks: list[str | dict[Any, Any]] = [image_block(member(self.folder, image)) for image in images]
        messages: list[BaseMessage] = [HumanMessage(content=[*blocks, {"type": "text", "text": text}])]
        problem = ""
        tries = self.config.reply_retries + 1
        for _ in range(tries):
            reply, problem = self._exchange(role, messages, text, images)
            if reply is not None:
                try:
                    return parse(reply)
                except ReplyError as error:
                    problem = str(error)
                messages.append(AIMessage(reply))
            text = f"Your reply could not be used: {problem}. Reply again in exactly the form asked for."
            if isinstance(messages[-1], HumanMessage):
                messages.append(AIMessage("(no usable reply)"))
            messages.append(HumanMessage(text))
            images = ()
        failure = NoReply(role=role, tries=tries, problem=problem)
        return failure

    def _exchange(
        self, role: str, messages: list[BaseMessage], text: str, images: Sequence[str]
    ) -> tuple[str | None, str]:
        model = self.config.model_for(role).model

        call = f"{role}-{uuid4().hex[:8]}"
        self.log.append(Prompt(call=call, role=role, model=model, text=text, images=tuple(images)))
        begin = time.perf_counter()
        try:
            answer = invoke(self.model(role), messages)
        except ReplyProblem as problem:
            seconds = time.perf_counter() - begin
            self.log.append(Reply(call=call, role=role, model=model, text="", seconds=seconds, error=str(problem)))
            return None, str(problem)
        usage = answer.usage_metadata
        cached = usage.get("input_token_details", {}).get("cache_read", 0) if usage else 0
        self.log.append(
            Reply(
                call=call,
                role=role,
                model=model,
                text=str(answer.text),
                input_tokens=usage["input_tokens"] if usage else 0,
                output_tokens=usage["output_tokens"] if usage else 0,
                cached_tokens=cached,
                cost=_cost(answer.response_metadata),
                seconds=time.perf_counter() - begin,
                finish_reason=str(answer.response_metadata.get("finish_reason", "")),
            )
        )
        return str(answer.text), ""


def _cost(metadata: Mapping[str, Any]) -> float | None:
    """What the provider says that the answer cost, US dollars; None where it does not tell."""
    usage = metadata.get("token_usage")
    told = cast(Mapping[str, Any], usage).get("cost") if isinstance(usage, Mapping) else None
    return float(told) if isinstance(told, int | float) and math.isfinite(told) else None


def image_block(path: Path) -> dict[str, str]:
    """A picture file as a standard LangChain image block (JPEG, longest side ``IMAGE_SIDE``).

    Raises:
        InputError: the file is not a picture.
    """
    image = read_picture(path, cv2.IMREAD_COLOR)
    scale = IMAGE_SIDE / max(image.shape[:2])
    if scale < 1:
        image = cv2.resize(image, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
    data = cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, 90])[1].tobytes()
    return {"type": "image", "base64": base64.b64encode(data).decode(), "mime_type": "image/jpeg"}
