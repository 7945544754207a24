"""A user's description of the fingers in an arm's file, kept in the file itself, so that both go together."""

from typing import Any, Final
from xml.parsers import expat
from xml.sax.saxutils import quoteattr

from pydantic import ValidationError

from grs_agents.base.config.schema import OwnHandConfig
from grs_agents.base.errors import InputError

_NAME: Final = "grs_hand"
"""Of the custom text in MJCF that holds the description as JSON."""


def describe_hand_in_mjcf(text: bytes, hand: OwnHandConfig) -> bytes:
    """A safe MJCF file with a description of its hand. Raises ``InputError``: it has another description."""
    parser, end = expat.ParserCreate(), 0

    def refuse_description(tag: str, attributes: dict[str, str]) -> None:
        if tag == "text" and attributes.get("name") == _NAME:
            raise InputError("the robot's file describes its hand already", f"remove own_hand, or the text {_NAME!r}")

    def note_end(_: str) -> None:
        nonlocal end
        end = parser.CurrentByteIndex  # at last that of the root

    parser.StartElementHandler, parser.EndElementHandler = refuse_description, note_end
    parser.Parse(text, True)
    element = f"<custom><text name={quoteattr(_NAME)} data={quoteattr(hand.model_dump_json())}/></custom>"
    return text[:end] + element.encode("ascii", "xmlcharrefreplace") + text[end:]


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
