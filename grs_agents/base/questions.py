"""A question to a person during a run: any node or policy may ask, and the run waits for the reply.

``interrupt(...)`` of LangGraph with any other value does the same; the value is then the question.
"""

import json
from collections.abc import Sequence
from typing import Any

from pydantic import ValidationError

from grs_agents.base import Frozen
from grs_agents.base.errors import InputError


class Question(Frozen):
    """The question of a waiting run."""

    text: str
    choices: tuple[str, ...] = ()  # allowed first words of a reply; () for any reply
    details: str = ""  # background for the answer


def ask_person(text: str, choices: Sequence[str] = (), details: str = "") -> str:
    """Ask, inside a node; the run ends with the status ``waiting`` and goes on here once ``grs approve`` has replied.

    The node is repeated from its beginning then, including its work before the question.

    Returns:
        The reply, which begins with a choice of ``choices``, if given.
    """
    from langgraph.types import interrupt  # takes long to import

    question = Question(text=text, choices=tuple(choices), details=details)
    return str(interrupt(question.model_dump(mode="json")))


def parse_question(value: Any) -> Question:
    """The question in the value of an ``interrupt``; any other value is its text."""
    try:
        return Question.model_validate(value)
    except ValidationError:
        text = value if isinstance(value, str) else json.dumps(value, default=str)
        return Question(text=text)


def first_word(reply: str) -> str:
    """The choice of a reply: its first word, without a colon or a full stop after it."""
    words = reply.split(maxsplit=1)
    return words[0].rstrip(":.,;") if words else ""


def require_reply_is_a_choice(question: Question, reply: str) -> None:
    """Raise ``InputError`` unless a reply begins with a choice of the question, if it has choices."""
    if not reply.strip():
        raise InputError("the reply is empty", f"answer: {question.text}"[:300])
    if question.choices and first_word(reply) not in question.choices:
        raise InputError(
            f"the reply {reply[:60]!r} begins with none of the choices",
            f"begin it with {' or '.join(question.choices)}",
        )
