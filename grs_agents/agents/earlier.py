"""Replies that a node got before it was interrupted: when it runs again they are taken from the event log."""

import hashlib
import json
from collections import defaultdict, deque
from collections.abc import Sequence

from langchain_core.messages import BaseMessage

from grs_agents.config import ModelConfig
from grs_agents.trace import Event, NodeStarted, Prompt, Reply


def digest(role: str, model: ModelConfig, messages: Sequence[BaseMessage]) -> str:
    """SHA-256 of all that a reply depends on: role, model, its settings, and every message with its pictures."""
    settings = model.model_dump(mode="json", include={"model", "base_url", "temperature", "max_tokens"})
    said = [(message.type, message.content) for message in messages]
    return hashlib.sha256(json.dumps([role, settings, said], sort_keys=True).encode()).hexdigest()


class EarlierReplies:
    """The replies to the node at work when the log ends, over all its visits in a row; each is given out once.

    Replies to nodes before it are not among them: a prompt that comes again in a later visit, such as that of a fix
    which changed nothing, is meant to be answered anew.

    Args:
        events: of the run so far.
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

    def take(self, prompt: str) -> Reply | None:
        """The next reply to the prompt with this digest; None if it has to be asked for."""
        replies = self._replies.get(prompt)
        return replies.popleft() if replies else None
