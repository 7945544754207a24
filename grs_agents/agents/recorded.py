"""Recorded replies: of an interrupted run that resumes, or of a cassette that is replayed."""

import hashlib
import json
import re
import threading
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pydantic import Field, ValidationError

from grs_agents.base import Frozen, content
from grs_agents.base.errors import InputError, UnknownNameError
from grs_agents.base.foreign.files import path_exists, read_json
from grs_agents.base.trace.events import Cost, Count, Event, Name, NodeStarted, Prompt, Reply, Text
from grs_agents.models.factory import is_offline

if TYPE_CHECKING:
    from langchain_core.messages import BaseMessage

REMEDY = "record the run anew: grs run SCENE --record FILE"
_HALF = 32
"""Hexadecimal digits of each half of a prompt's digest."""
_NUMBER = re.compile(r"(?<![A-Za-z_\d.])-?\d+(?:\.\d+)?(?:e-?\d+)?")
_COPIED = {"role", "model", "finish_reason", "input_tokens", "output_tokens", "cached_tokens", "cost", "error"}
"""Fields that an exchange copies from a reply."""


def digest_prompt(role: str, messages: Sequence["BaseMessage"], pictures: Sequence[str]) -> str:
    """Digest of everything that a reply depends on besides the model, as two halves of 32 hexadecimal digits.

    The first half covers the role, the words of all messages and the pictures' names: it is equal on every machine. The
    second half covers the numbers and pixels too, which another processor measures and renders a little differently.
    """
    words = [(message.type, _replace_numbers_with_hash_sign(str(message.text))) for message in messages]
    contents = [(message.type, message.content) for message in messages]
    return "".join(_sha256_of_json([role, *pictures, part])[:_HALF] for part in (words, contents))


def digest_prompt_sections(text: str) -> dict[str, str]:
    """Short digest of the words of each section of a prompt, by heading, to locate differences between prompts."""
    parts = (part.partition("\n") for part in re.split(r"^#+ ", text, flags=re.MULTILINE) if part.strip())
    return {heading.strip(): _sha256_of_json(_replace_numbers_with_hash_sign(body))[:8] for heading, _, body in parts}


def _replace_numbers_with_hash_sign(text: str) -> str:
    """``text`` with ``#`` in place of each number; digits that are part of a name stay."""
    return _NUMBER.sub("#", text)


def _sha256_of_json(value: object) -> str:
    return hashlib.sha256(json.dumps(value).encode()).hexdigest()


class RecordedReplies:
    """Replies by the digests of their prompts. Each is given out once; replies to equal prompts keep their order."""

    def __init__(self, exchanges: Iterable[tuple[str, Reply]] = (), tolerant: bool = False) -> None:
        self._waiting = list(exchanges)
        # how much of a digest must agree, best first: a recording may have been made on another machine
        self._lengths = (2 * _HALF, _HALF) if tolerant else (2 * _HALF,)
        self._lock = threading.Lock()

    def take_reply(self, digest: str) -> Reply | None:
        """The next reply to the prompt with this digest; None if there is none that was not given out."""
        with self._lock:
            for length in self._lengths:
                for number, (recorded, reply) in enumerate(self._waiting):
                    if recorded[:length] == digest[:length]:
                        del self._waiting[number]
                        return reply
        return None


def collect_last_node_replies(events: Sequence[Event]) -> RecordedReplies:
    """The replies to the node at work when the log ends, over all its visits in a row.

    Replies to nodes before it are not among them: a prompt that comes again in a later visit, such as that of a fix
    which changed nothing, is meant to be answered anew.
    """
    node, begin = "", 0
    for number, event in enumerate(events):
        if isinstance(event, NodeStarted) and event.node != node:
            node, begin = event.node, number
    return RecordedReplies((prompt.digest, reply) for prompt, reply in _pair_answered_prompts(events[begin:]))


def _pair_answered_prompts(events: Sequence[Event]) -> list[tuple[Prompt, Reply]]:
    """The prompts that a model answered, each with its reply, in order."""
    replies = {event.call: event for event in events if isinstance(event, Reply) and event.answered}
    prompts = (event for event in events if isinstance(event, Prompt) and event.digest)
    return [(prompt, replies[prompt.call]) for prompt in prompts if prompt.call in replies]


def collect_model_replies(events: Sequence[Event]) -> RecordedReplies:
    """The replies to all roles of a run; the offline model is left out, since it can be asked again.

    Of equal prompts the last comes first: a program that was audited twice was judged by the second reply.
    """
    pairs = [(prompt.digest, reply) for prompt, reply in _pair_answered_prompts(events) if not is_offline(prompt.model)]
    return RecordedReplies(reversed(pairs), tolerant=True)


class Exchange(Frozen):
    """A prompt, by its digests, and the model's reply."""

    role: Name
    model: Name  # who replied
    digest: str = Field(pattern=r"^[0-9a-f]{64}$")  # `digest_prompt` of the conversation
    sections: dict[str, str]  # `digest_prompt_sections` of its last message
    pictures: tuple[str, ...]  # their names in the run folder
    finish_reason: Name
    input_tokens: Count
    output_tokens: Count
    cached_tokens: Count
    cost: Cost | None  # US dollars
    error: Text  # why the reply could not be used; empty if it could
    reply: tuple[str, ...]  # its lines


class Cassette(Frozen):
    """A recorded run as a readable file."""

    about: str = "What models replied in a run of GRS. `grs run --cassette FILE` repeats the run without them."
    version: str  # of grs-agents
    scene: str  # its name
    settings: dict[str, Any]  # the configuration where it differs from the default; dotted key -> value
    status: Name  # how the run ended
    reason: Text
    files: dict[Name, str]  # files of the run, relative to its folder, each with a digest
    exchanges: tuple[Exchange, ...]

    def remaining_replies(self, events: Sequence[Event]) -> RecordedReplies:
        """The replies that were not used in the attempts of ``events``."""
        replies = [
            (item.digest, Reply(call="", text="\n".join(item.reply), **item.model_dump(include=_COPIED)))
            for item in self.exchanges
        ]
        waiting = RecordedReplies(replies, tolerant=True)
        for prompt, _ in _pair_answered_prompts(events):
            waiting.take_reply(prompt.digest)
        return waiting


class MissingReply(InputError):
    """A prompt that the cassette has no reply to."""


def read_cassette(name: str) -> Cassette:
    """Read the cassette from the file of this name, else the shipped cassette of this name.

    Raises:
        UnknownNameError: there is neither.
        InputError: the file is no cassette.
    """
    shipped = content.shipped_cassettes()
    file = Path(name) if path_exists(Path(name)) else shipped.get(name)
    if file is None:
        raise UnknownNameError("cassette", name, shipped)
    try:
        return Cassette.model_validate(read_json(file, REMEDY))
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        raise InputError(f"{file} is not a cassette: {first['loc'][0]}: {first['msg']}", REMEDY) from error


def collect_exchanges(events: Sequence[Event]) -> tuple[Exchange, ...]:
    """The exchanges of a run, from its log."""
    return tuple(
        Exchange(
            digest=prompt.digest,
            sections=digest_prompt_sections(prompt.text),
            pictures=prompt.images,
            reply=tuple(reply.text.split("\n")),
            **reply.model_dump(include=_COPIED),
        )
        for prompt, reply in _pair_answered_prompts(events)
    )


def explain_missing_reply(name: str, role: str, text: str) -> MissingReply:
    """Explain why the cassette has no reply to a prompt that ends with ``text``: its nearest prompt, and their
    differences."""
    sections = digest_prompt_sections(text).items()
    exchanges = [(number, item) for number, item in enumerate(read_cassette(name).exchanges, 1) if item.role == role]
    what = f"cassette {name!r} has no reply to this prompt of the role {role}"
    if not exchanges:
        return MissingReply(f"{what}, nor to any other", REMEDY)
    number, nearest = max(exchanges, key=lambda pair: len(sections & pair[1].sections.items()))
    differ = sorted({heading for heading, _ in sections ^ nearest.sections.items()})
    how = f"differs in {', '.join(differ)}" if differ else "has the same last message, and was given out before"
    return MissingReply(f"{what}; the nearest, exchange {number}, {how}", REMEDY)
