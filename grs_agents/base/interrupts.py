"""Requests to end (Ctrl-C, SIGTERM): raised in the main thread, and remembered.

An exception that is raised while a module of another package is imported, in a destructor or in a callback of C code
may be dropped there. Long operations check ``is_interrupt_requested`` first.
"""

import signal
from types import FrameType

_came: list[int] = []


def install_signal_handlers() -> None:
    """Let SIGINT and SIGTERM raise ``KeyboardInterrupt`` from now on, unless this process ignores them."""
    _came.clear()
    for number in (signal.SIGINT, signal.SIGTERM):
        if signal.getsignal(number) is not signal.SIG_IGN:
            signal.signal(number, _raise_interrupt)


def is_interrupt_requested() -> bool:
    """True after a request to end since ``install_signal_handlers``."""
    return bool(_came)


def request_interrupt() -> None:
    """Have runs end before their next step, as a signal would, without an exception here."""
    _came.append(signal.SIGTERM)


def _raise_interrupt(number: int, frame: FrameType | None) -> None:
    _came.append(number)
    raise KeyboardInterrupt
