"""The worker's way to speak to the host: a pipe of its own, so that printing cannot disturb it.

Frames are sealed with a key that the host made for this call and sent along with the request. The key lies in a
closure, not in a module or in the request that a tool sees, so code that writes to the pipe, or keeps a copy of a
frame, is detected. It is no secret from code in the same interpreter that searches for it, through ``gc`` or the frames
of callers, and such code may call ``report_progress`` itself. So a result can be forged, and may mislead a router. The
decision to accept a task reads task instances only, in a process that never ran generated code.
"""

import os
import sys
from collections.abc import Callable, Mapping
from itertools import count
from typing import Any

from grs_agents.base.errors import GrsError
from grs_agents.sandbox.protocol import wire

Frame = Mapping[str, Any]
_sender: list[Callable[[Frame], None]] = []


def connect(descriptor: int, key: str | None = None) -> None:
    """Send every later frame to the pipe ``descriptor``, sealed with ``key`` (of ``wire.new_key``) and numbered from 0.

    Frames without a key are not sealed: only those before the request.
    """
    secret, numbers = None if key is None else bytes.fromhex(key), count()

    def write(frame: Frame) -> None:
        # Only encoded frames are counted: a frame that was not plain JSON leaves no gap.
        plain = wire.encode(frame)
        data = memoryview(plain if secret is None else wire.sign_frame(plain, secret, next(numbers)))
        while data:
            data = data[os.write(descriptor, data) :]

    _sender[:] = [write]


def send(frame: Frame) -> None:
    """Write a frame whole; ``ValueError`` or ``TypeError``, and nothing is written, if it is not plain JSON."""
    if not _sender:
        raise GrsError("this process is not a sandbox worker", "call the tool through Sandbox.call")
    _sender[0](frame)


def report_progress(event: Frame) -> None:
    """Report ``event`` (plain JSON) at once; the host keeps it even if this process dies right after."""
    sys.stdout.flush()  # earlier output comes before the event
    send({"kind": "event", "event": event})
