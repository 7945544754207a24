"""A user's description of the fingers in an arm's file, kept in the file itself, so that both go together."""

from typing import Any, Final
from xml.sax.saxutils import quoteattr

from pydantic import ValidationError

from grs_agents.base.config.schema import OwnHandConfig
from grs_agents.base.errors import InputError

_NAME: Final = "grs_hand"
"""Of the custom text in MJCF that holds the description as JSON."""


def describe_hand_in_mjcf(text: bytes, hand: OwnHandConfig) -> bytes:
    """An MJCF file with a description of its hand, in place of none."""
    head, end, tail = text.rpartition(b"</mujoco>")
    element = f"<custom><text name={quoteattr(_NAME)} data={quoteattr(hand.model_dump_json())}/></custom>"
    return head + element.encode() + end + tail


def read_described_hand(spec: Any, robot: str) -> OwnHandConfig | None:
    """The description of the hand in a robot's spec, if any; raises ``InputError`` if it is none."""
    for text in spec.texts:
        if str(text.name) == _NAME:
            try:
                return OwnHandConfig.model_validate_json(str(text.data))
            except ValidationError as error:
                reason = str(error.errors()[0]["msg"])[:200]
                raise InputError(f"robot {robot}: its text {_NAME!r} describes no hand: {reason}", "mend it") from error
    return None
