"""A question to a person in the middle of a run: any node or policy may ask one, and the run waits for the reply.

``interrupt(...)`` of LangGraph with a value of one's own does the same; its value is then the question.
"""

import json
from collections.abc import Sequence
from typing import Any

from pydantic import ValidationError

from grs_agents.base import Frozen
from grs_agents.base.errors import InputError


class Question(Frozen):
    """What a run waits for."""

    text: str
    choices: tuple[str, ...] = ()  # what a reply begins with; () where any reply will do
    details: str = ""  # what the person should know to answer


def ask_person(text: str, choices: Sequence[str] = (), details: str = "") -> str:
    """Ask, inside a node; the run ends with the status ``waiting`` and goes on here once ``grs approve`` has replied.

    The node begins anew then: what it did before the question it does again.

    Returns:
        The reply, which begins with one of ``choices`` if there are any.
    """
    from langgraph.types import interrupt  # takes long to import

    question = Question(text=text, choices=tuple(choices), details=details)
    return str(interrupt(question.model_dump(mode="json")))


def parse_question(value: Any) -> Question:
    """The question that the value of an ``interrupt`` holds; any other value is the text of one."""
    try:
        return Question.model_validate(value)
    except ValidationError:
        text = value if isinstance(value, str) else json.dumps(value, default=str)
        return Question(text=text)


def first_word(reply: str) -> str:
    """What a reply chooses: its first word, without a colon or a full stop after it."""
    words = reply.split(maxsplit=1)
    return words[0].rstrip(":.,;") if words else ""


def require_reply_is_a_choice(question: Question, reply: str) -> None:
    """Raise ``InputError`` unless a reply begins with one of the question's choices, if it has any."""
    if not reply.strip():
        raise InputError("the reply is empty", f"answer: {question.text}"[:300])
    if question.choices and first_word(reply) not in question.choices:
        raise InputError(
            f"the reply {reply[:60]!r} begins with none of the choices",
            f"begin it with {' or '.join(question.choices)}",
        )
