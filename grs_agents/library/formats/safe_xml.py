"""Reading XML that strangers wrote: bounded in length and depth, no document types, no entities, no inclusions."""

from collections.abc import Callable
from pathlib import Path
from xml.etree import ElementTree
from xml.parsers import expat

from grs_agents import foreign
from grs_agents.errors import InputError

MAX_BYTES, MAX_DEPTH = 1_000_000, 32

Fault = Callable[[str, str], InputError]
"""The error for a message and a remedy, telling which file they are about."""


def read_text(path: Path) -> str:
    """The text of a small UTF-8 file.

    Raises:
        InputError: it cannot be read or is too large.
    """
    return foreign.read_text(path, "give a small file in UTF-8", MAX_BYTES)


def parse(text: str, fault: Fault) -> ElementTree.Element:
    """The root element of ``text``.

    Raises:
        InputError: it is not XML, or XML that we do not trust.
    """
    if len(text) > MAX_BYTES:
        raise fault(f"longer than {MAX_BYTES} characters", "split or simplify the file")
    guard, depth = expat.ParserCreate(), 0

    def refuse(*_: object) -> None:
        raise fault("document types and entities are refused", "remove <!DOCTYPE ...>")

    def enter(tag: str, _: dict[str, str]) -> None:
        nonlocal depth
        depth += 1
        if tag.rpartition(":")[2] == "include":
            raise fault(f"<{tag}> is refused", "put what it includes into the file")
        if depth > MAX_DEPTH:
            raise fault(f"<{tag}> is nested deeper than {MAX_DEPTH}", "simplify the file")

    def leave(_: str) -> None:
        nonlocal depth
        depth -= 1

    guard.StartDoctypeDeclHandler = refuse
    guard.EntityDeclHandler = refuse
    guard.StartElementHandler, guard.EndElementHandler = enter, leave
    try:
        guard.Parse(text, True)
        return ElementTree.fromstring(text)
    except (expat.ExpatError, ElementTree.ParseError, ValueError) as error:
        raise fault(f"not XML: {error}", "correct the file") from error


def refuse_doctype(data: bytes, fault: Fault, depth: int = 64) -> None:
    """Check XML of any length that another reader is to read: no document types, no entities, not too deep.

    Raises:
        InputError: it is not XML, or XML that we do not trust.
    """
    guard, open_tags = expat.ParserCreate(), 0

    def refuse(*_: object) -> None:
        raise fault("document types and entities are refused", "remove <!DOCTYPE ...>")

    def enter(tag: str, _: dict[str, str]) -> None:
        nonlocal open_tags
        open_tags += 1
        if open_tags > depth:
            raise fault(f"<{tag}> is nested deeper than {depth}", "simplify the file")

    def leave(_: str) -> None:
        nonlocal open_tags
        open_tags -= 1

    guard.StartDoctypeDeclHandler = refuse
    guard.EntityDeclHandler = refuse
    guard.StartElementHandler, guard.EndElementHandler = enter, leave
    try:
        guard.Parse(data, True)
    except (expat.ExpatError, ValueError) as error:
        raise fault(f"not XML: {error}", "correct the file") from error
