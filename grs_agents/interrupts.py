"""Requests to end (Ctrl-C, SIGTERM): raised where the program is, and remembered.

An exception that is raised while a module of another package is imported, in a destructor or in a callback of C code
may be dropped there. Whoever starts something long asks ``requested`` first.
"""

import signal
from types import FrameType

_came: list[int] = []


def catch() -> None:
    """Let SIGINT and SIGTERM raise ``KeyboardInterrupt`` from now on, unless this process was told to ignore them."""
    _came.clear()
    for number in (signal.SIGINT, signal.SIGTERM):
        if signal.getsignal(number) is not signal.SIG_IGN:
            signal.signal(number, _interrupt)


def requested() -> bool:
    """Whether a request to end has come since ``catch``."""
    return bool(_came)


def _interrupt(number: int, frame: FrameType | None) -> None:
    _came.append(number)
    raise KeyboardInterrupt
