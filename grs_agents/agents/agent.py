"""An agent: a prompt, a chat model and a strict parser; every exchange is an event."""

import base64
import hashlib
import json
import time
from collections import defaultdict, deque
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TypeVar
from uuid import uuid4

import cv2
import numpy.typing as npt
from langchain_core.language_models.chat_models import BaseChatModel
from langchain_core.messages import AIMessage, BaseMessage, HumanMessage

from grs_agents import content
from grs_agents.agents.prompt_template import render_prompt_template
from grs_agents.agents.reply import ReplyError
from grs_agents.agents.types import NoReply
from grs_agents.config import Config, ModelConfig
from grs_agents.foreign import read_picture, resolve_member_file
from grs_agents.models import Answer, ReplyProblem, invoke_with_retries, make_chat_model, retries_for
from grs_agents.trace import Event, EventLog, NodeStarted, Note, Prompt, Reply

Parsed = TypeVar("Parsed")
IMAGE_SIDES = (256, 1024)
"""Pictures whose longer side has fewer or more pixels are enlarged or reduced before they are sent."""


def hash_model_request(role: str, model: ModelConfig, messages: Sequence[BaseMessage]) -> str:
    """SHA-256 of all that a reply depends on: role, model, its settings, and every message with its pictures."""
    settings = model.model_dump(mode="json", include={"model", "base_url", "temperature", "max_tokens", "arguments"})
    contents = [(message.type, message.content) for message in messages]
    return hashlib.sha256(json.dumps([role, settings, contents], sort_keys=True).encode()).hexdigest()


class EarlierReplies:
    """The replies to the node at work when the log ends, over all its visits in a row; each is given out once.

    Replies to nodes before it are not among them: a prompt that comes again in a later visit, such as that of a fix
    which changed nothing, is meant to be answered anew.
    """

    def __init__(self, events: Sequence[Event] = ()) -> None:
        self._replies: dict[str, deque[Reply]] = defaultdict(deque)
        digests: dict[str, str] = {}
        node = ""
        for event in events:
            if isinstance(event, NodeStarted) and event.node != node:
                node = event.node
                self._replies.clear()
            elif isinstance(event, Prompt):
                digests[event.call] = event.digest
            elif isinstance(event, Reply) and event.answered and digests.get(event.call):
                self._replies[digests[event.call]].append(event)

    def pop_reply_by_digest(self, prompt: str) -> Reply | None:
        """The next reply to the prompt with this digest; None if it has to be asked for."""
        replies = self._replies.get(prompt)
        return replies.popleft() if replies else None


@dataclass
class Agents:
    """The models by role, what they may cost, and the log of all they were asked."""

    config: Config  # names the model, the prompt and the retries of each role
    log: EventLog
    folder: Path  # the run folder; images are given relative to it
    # replies that were paid for before the run was interrupted
    earlier: EarlierReplies = field(default_factory=EarlierReplies)
    _models: dict[str, BaseChatModel] = field(default_factory=dict[str, BaseChatModel])

    def chat_model_for_role(self, role: str) -> BaseChatModel:
        """The chat model that serves ``role``, made once."""
        spec = self.config.model_for_role(role)
        key = spec.model_dump_json()
        if key not in self._models:
            self._models[key] = make_chat_model(spec, self.config.seed)
        return self._models[key]

    def ask_role(
        self, role: str, values: Mapping[str, str], parse: Callable[[str], Parsed], images: Sequence[str] = ()
    ) -> Parsed | NoReply:
        """Ask ``role`` and parse its reply; a reply that does not parse is asked for again with the error.

        Args:
            role: one of the agent roles.
            values: the prompt's variables.
            parse: raises ``ReplyError`` on a reply of the wrong form.
            images: picture files relative to the run folder, sent before the text in this order.
        """
        file = content.content_path("prompts", getattr(self.config.prompts, role))
        text = render_prompt_template(file, role, values)
        blocks: list[str | dict[Any, Any]] = [
            image_block_from_file(resolve_member_file(self.folder, image)) for image in images
        ]
        messages: list[BaseMessage] = [HumanMessage(content=[*blocks, {"type": "text", "text": text}])]
        problem = ""
        tries = self.config.reply_retries + 1
        for _ in range(tries):
            reply, problem = self._request_or_reuse_reply(role, messages, text, images)
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
        return NoReply(role=role, tries=tries, problem=problem)

    def _request_or_reuse_reply(
        self, role: str, messages: list[BaseMessage], text: str, images: Sequence[str]
    ) -> tuple[str | None, str]:
        """The text of the reply, or None and why there is none that can be used."""
        spec = self.config.model_for_role(role)
        prompt = hash_model_request(role, spec, messages)
        if (earlier := self.earlier.pop_reply_by_digest(prompt)) is not None:
            self.log.append(Note(level="info", text=f"the reply to {earlier.call} was paid for and is used again"))
            return (None, earlier.error) if earlier.error else (earlier.text, "")
        call = f"{role}-{uuid4().hex[:8]}"
        self.log.append(Prompt(call=call, role=role, model=spec.model, text=text, images=tuple(images), digest=prompt))
        begin = time.perf_counter()
        answer, error, answered = Answer(""), "", True
        try:
            answer = invoke_with_retries(self.chat_model_for_role(role), messages, retries_for(spec))
            for failed in answer.failed:
                self.log.append(Note(level="warning", text=f"{answer.model} is asked in place of {failed}"))
        except ReplyProblem as problem:
            answer, error = problem.answer or answer, str(problem)
            return None, error
        except BaseException as problem:
            error, answered = f"{type(problem).__name__}: {problem}", False
            raise
        finally:
            self.log.append(
                Reply(
                    call=call,
                    role=role,
                    model=answer.model or spec.model,
                    text=answer.text,
                    input_tokens=answer.input_tokens,
                    output_tokens=answer.output_tokens,
                    cached_tokens=answer.cached_tokens,
                    cost=answer.cost,
                    seconds=time.perf_counter() - begin,
                    finish_reason=answer.finish_reason,
                    error=error,
                    answered=answered,
                )
            )
        return answer.text, ""


def image_block_from_file(path: Path) -> dict[str, str]:
    """A picture file as ``image_block_from_array`` makes it."""
    return image_block_from_array(read_picture(path, cv2.IMREAD_COLOR))


def image_block_from_array(image: npt.NDArray[Any]) -> dict[str, str]:
    """A picture (H, W, 3), blue first, as a standard LangChain image block: JPEG, its size as ``IMAGE_SIDES`` says."""
    longest = max(image.shape[:2])
    scale = min(max(longest, IMAGE_SIDES[0]), IMAGE_SIDES[1]) / longest
    if scale != 1:
        way = cv2.INTER_AREA if scale < 1 else cv2.INTER_CUBIC
        image = cv2.resize(image, None, fx=scale, fy=scale, interpolation=way)
    data = cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, 90])[1].tobytes()
    return {"type": "image", "base64": base64.b64encode(data).decode(), "mime_type": "image/jpeg"}
