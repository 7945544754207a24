"""An agent: a prompt, a chat model and a strict parser; every exchange is an event."""

import base64
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from threading import Lock
from typing import TYPE_CHECKING, Any, TypeVar
from uuid import uuid4

import cv2
import numpy.typing as npt

from grs_agents.agents.budget import check_budget_left
from grs_agents.agents.prompt_template import render_prompt_template
from grs_agents.agents.recorded import (
    RecordedReplies,
    collect_last_node_replies,
    digest_prompt,
    explain_missing_reply,
    read_cassette,
)
from grs_agents.agents.reply import ReplyError
from grs_agents.agents.reply_schema import reply_schema
from grs_agents.agents.types import NoReply
from grs_agents.base import content
from grs_agents.base.config.schema import Config, ModelConfig
from grs_agents.base.foreign.pictures import read_picture
from grs_agents.base.foreign.run_folder import resolve_member_file
from grs_agents.base.trace.events import MOST_COST, CostSource, Note, Prompt, Reply
from grs_agents.base.trace.log import EventLog, read_events
from grs_agents.models.answer import Answer, ReplyProblem
from grs_agents.models.call import SchemaSupport, invoke_with_retries
from grs_agents.models.factory import is_offline, make_chat_model, make_retries, takes_pictures, takes_schema

if TYPE_CHECKING:  # LangChain takes long to import, and a check of programs may need no model
    from langchain_core.language_models.chat_models import BaseChatModel
    from langchain_core.messages import BaseMessage

Parsed = TypeVar("Parsed")
IMAGE_SIDES = (256, 1024)
"""Pictures whose longer side has fewer or more pixels are enlarged or reduced before they are sent."""


@dataclass
class Agents:
    """Chat models by role, their budget, and the log of their exchanges."""

    config: Config  # names the model, the prompt and the retries of each role
    log: EventLog
    folder: Path  # the run folder; images are given relative to it
    # paid replies from before the interruption of the run
    earlier: RecordedReplies = field(default_factory=RecordedReplies)
    cassette: RecordedReplies | None = None  # a recorded run's replies, used instead of the models
    # roles that were shown pictures, in a run that is replayed without its models; None otherwise
    pictured: frozenset[str] | None = None
    _models: dict[str, "BaseChatModel"] = field(default_factory=dict[str, "BaseChatModel"])
    _supports: dict[str, SchemaSupport] = field(default_factory=dict[str, SchemaSupport])  # by model too
    _lock: Lock = field(default_factory=Lock)

    def __post_init__(self) -> None:
        if self.pictured is None and self.config.cassette and not self.config.record:
            exchanges = read_cassette(self.config.cassette).exchanges
            self.pictured = frozenset(exchange.role for exchange in exchanges if exchange.pictures)

    @classmethod
    def resume_from_log(cls, config: Config, log: EventLog, folder: Path) -> "Agents":
        """Resume at the end of the log: replies to its last node are used again."""
        events = read_events(log.path)
        cassette = read_cassette(config.cassette).remaining_replies(events) if config.cassette else None
        return cls(config, log, folder, collect_last_node_replies(events), cassette)

    def chat_model_for_role(self, role: str) -> "BaseChatModel":
        """The chat model that serves ``role``, made once."""
        spec = self.config.model_for_role(role)
        key = spec.model_dump_json()
        with self._lock:  # roles are asked from several threads
            if key not in self._models:
                self._models[key] = make_chat_model(spec, self.config.seed)
            return self._models[key]

    def sees_pictures(self, role: str) -> bool:
        """True if pictures are worth drawing for ``role``: its model takes them, and is not the embedded one."""
        return not is_offline(self.config.model_for_role(role).model) and self.takes_pictures(role)

    def takes_pictures(self, role: str) -> bool:
        """True if pictures are sent to the model of ``role``; in a replayed run, if they were."""
        spec = self.config.model_for_role(role)
        if self.pictured is not None and not is_offline(spec.model):
            return role in self.pictured
        return takes_pictures(spec, self.chat_model_for_role(role))

    def ask_role(
        self,
        role: str,
        values: Mapping[str, str],
        parse: Callable[[str], Parsed],
        images: Sequence[str] = (),
        prompt_of: str | None = None,
    ) -> Parsed | NoReply:
        """Ask ``role`` and parse its reply; a reply that does not parse is requested again, with the error.

        Args:
            role: an agent role.
            values: the prompt's variables.
            parse: raises ``ReplyError`` on a reply of the wrong form.
            images: picture files relative to the run folder, sent after the text in this order; none are sent to a
                model that takes none.
            prompt_of: the role whose prompt is used, if not ``role``'s.
        """
        from langchain_core.messages import AIMessage, HumanMessage

        prompt_role = prompt_of or role
        file = content.content_path("prompts", getattr(self.config.prompts, prompt_role))
        images = images if images and self.takes_pictures(role) else ()
        blocks = [image_block_from_file(resolve_member_file(self.folder, image)) for image in images]
        messages = render_prompt_template(file, prompt_role, values).to_messages(blocks)
        problem = ""
        tries = self.config.reply_retries + 1
        for _ in range(tries):
            reply, problem = self.get_earlier_or_new_reply(role, messages, tuple(images))
            if reply is not None:
                try:
                    return parse(reply)
                except ReplyError as error:
                    problem = str(error)
                messages.append(AIMessage(reply))
            text = (
                f"Your reply could not be used: {problem}. Reply again, with all of it, in exactly the form asked for."
            )
            if isinstance(messages[-1], HumanMessage):
                messages.append(AIMessage("(no usable reply)"))
            messages.append(HumanMessage(text))
        return NoReply(role=role, tries=tries, problem=problem)

    def get_earlier_or_new_reply(
        self,
        role: str,
        messages: Sequence["BaseMessage"],
        pictures: tuple[str, ...],
        ask: Callable[[], Answer] | None = None,
    ) -> tuple[str | None, str]:
        """The reply to ``messages``, recorded or new; ``pictures`` are in the first user message.

        ``ask`` replaces the plain call of the model with the messages.

        Returns: the text of the reply and an empty problem, or None and the problem.
        """
        digest = digest_prompt(role, messages, pictures)
        answered = max((number for number, item in enumerate(messages, 1) if item.type == "ai"), default=0)
        text = "\n\n".join(str(item.text).strip() for item in messages[answered:])
        reply = self.earlier.take_reply(digest)
        if reply is not None:
            self.log.append(Note(level="info", text=f"the reply to {reply.call} was paid for and is used again"))
        else:
            check_budget_left(self.config.budget, self.log.path)
            recorded = self.cassette.take_reply(digest) if self.cassette else None
            if recorded is None and self.config.cassette and not self.config.record:
                raise explain_missing_reply(self.config.cassette, role, text)
            call, spec = f"{role}-{uuid4().hex[:8]}", self.config.model_for_role(role)
            shown = () if answered else pictures
            self.log.append(Prompt(call=call, role=role, model=spec.model, text=text, images=shown, digest=digest))
            if recorded is None:
                reply = self._request_reply(role, spec, call, ask or (lambda: self._invoke_model(role, spec, messages)))
            else:
                reply = self._append_reply(recorded.model_copy(update={"call": call}))
        return (None, reply.error) if reply.error else (reply.text, "")

    def _invoke_model(self, role: str, spec: ModelConfig, messages: Sequence["BaseMessage"]) -> Answer:
        model, retries = self.chat_model_for_role(role), make_retries(spec)
        schema = reply_schema(role) if takes_schema(spec) else None
        if schema is None:
            return invoke_with_retries(model, messages, retries)
        with self._lock:
            support = self._supports.setdefault(spec.model_dump_json(), SchemaSupport())
        before = support.refusal
        answer = invoke_with_retries(model, messages, retries, schema, support)
        if support.refusal != before:
            text = f"{spec.model} is asked for text from now on, since it takes no schema of a reply: {support.refusal}"
            self.log.append(Note(level="info", text=text))
        return answer

    def _request_reply(self, role: str, spec: ModelConfig, call: str, ask: Callable[[], Answer]) -> Reply:
        """Ask the model; its answer, usable or not, or its error is appended to the log."""
        begin = time.perf_counter()
        answer, error, answered = Answer(""), "", True
        try:
            answer = ask()
            for failed in answer.failed:
                self.log.append(Note(level="warning", text=f"{answer.model} is asked in place of {failed}"))
        except ReplyProblem as problem:
            answer, error = problem.answer or answer, str(problem)
        except BaseException as problem:
            error, answered = f"{type(problem).__name__}: {problem}", False
            raise
        finally:
            model = answer.model or spec.model
            cost, source = self._cost_of(model, answer)
            reply = self._append_reply(
                Reply(
                    call=call,
                    role=role,
                    model=model,
                    text=answer.text,
                    input_tokens=answer.input_tokens,
                    output_tokens=answer.output_tokens,
                    cached_tokens=answer.cached_tokens,
                    cost=cost,
                    cost_source=source,
                    seconds=time.perf_counter() - begin,
                    finish_reason=answer.finish_reason,
                    error=error,
                    answered=answered,
                )
            )
        return reply

    def _cost_of(self, model: str, answer: Answer) -> tuple[float | None, CostSource]:
        """The cost of an answer of ``model`` in US dollars, as its provider tells or by the configured prices."""
        if answer.cost is not None:
            return answer.cost, "provider"
        price = self.config.price_of(model)
        if price is None or not answer.input_tokens + answer.output_tokens:
            return None, "unknown"
        cached = min(answer.cached_tokens, answer.input_tokens)
        rate = price.input if price.cached is None else price.cached
        cost = (answer.input_tokens - cached) * price.input + cached * rate + answer.output_tokens * price.output
        return min(cost / 1e6, MOST_COST), "prices"

    def _append_reply(self, reply: Reply) -> Reply:
        self.log.append(reply)
        if self.config.budget.cost is not None and reply.cost is None and not is_offline(reply.model):
            text = (
                f"{reply.model} tells no cost, and prices has none for it: budget.cost counts {reply.call} as nothing; "
                "budget.tokens holds"
            )
            self.log.append(Note(level="warning", text=text))
        return reply


def image_block_from_file(path: Path) -> dict[str, str]:
    """A picture file as an image block; see ``image_block_from_array``."""
    return image_block_from_array(read_picture(path, cv2.IMREAD_COLOR))


def image_block_from_array(image: npt.NDArray[Any]) -> dict[str, str]:
    """A BGR picture (H, W, 3) as a standard LangChain image block: JPEG, scaled to the bounds ``IMAGE_SIDES``."""
    longest = max(image.shape[:2])
    scale = min(max(longest, IMAGE_SIDES[0]), IMAGE_SIDES[1]) / longest
    if scale != 1:
        way = cv2.INTER_AREA if scale < 1 else cv2.INTER_CUBIC
        image = cv2.resize(image, None, fx=scale, fy=scale, interpolation=way)
    data = cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, 90])[1].tobytes()
    return {"type": "image", "base64": base64.b64encode(data).decode(), "mime_type": "image/jpeg"}
