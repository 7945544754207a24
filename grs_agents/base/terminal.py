"""The only writer to the terminal: foreign text cannot command it, reorder it or end the program.

File names, replies of models, programs and their errors are shown as they are. A terminal obeys the control characters
in them; here these are escaped in printed text, cells of tables and messages of errors.
"""

import argparse
import json
import logging
import sys
from contextvars import ContextVar
from typing import TYPE_CHECKING, Any, Final, Literal, NoReturn

from grs_agents.base.control_characters import escape_control_chars

if TYPE_CHECKING:
    from rich.console import Console


VERBOSITY: Final[ContextVar[Literal["quiet", "normal", "verbose"]]] = ContextVar("VERBOSITY", default="normal")
"""Verbosity beside results and errors: no progress, a line for each step, or each event and traceback."""


def print_escaped(*words: object, error: bool = False, end: str = "\n", flush: bool = False) -> None:
    """Print ``words`` with control characters escaped."""
    file = sys.stderr if error else sys.stdout
    print(escape_control_chars(" ".join(map(str, words))), end=end, file=file, flush=flush)


def print_json(value: Any) -> None:
    """Print ``value`` as indented JSON in ASCII, which holds no control characters."""
    print(json.dumps(value, indent=2).replace("\x7f", "\\u007f"))


def make_console(error: bool = False) -> "Console":
    """A console for tables, or on standard error for progress, hidden if ``VERBOSITY`` is quiet."""
    from grs_agents.base.rich_console import EscapingConsole

    return EscapingConsole(stderr=error, markup=False, emoji=False, quiet=error and VERBOSITY.get() == "quiet")


class EscapingFormatter(logging.Formatter):
    """Formats log records of libraries with control characters escaped."""

    def format(self, record: logging.LogRecord) -> str:
        """Format a record as text."""
        return escape_control_chars(super().format(record))


class EscapingParser(argparse.ArgumentParser):
    """A parser whose errors repeat its input with control characters escaped."""

    def exit(self, status: int = 0, message: str | None = None) -> NoReturn:
        """End the program with ``status`` after ``message``."""
        super().exit(status, None if message is None else escape_control_chars(message))
