"""The worker's way to speak to the host: a pipe of its own, so that printing cannot disturb it."""

import os
import sys
from collections.abc import Mapping
from typing import Any

from grs_agents.errors import GrsError
from grs_agents.sandbox import wire

_descriptor: list[int] = []


def connect(descriptor: int) -> None:
    """Send every later frame to the pipe ``descriptor``."""
    _descriptor[:] = [descriptor]


def send(frame: Mapping[str, Any]) -> None:
    """Write one frame whole.

    Raises:
        ValueError, TypeError: the frame is not plain JSON; nothing was written.
        GrsError: this process is not a sandbox worker.
    """
    if not _descriptor:
        raise GrsError("this process is not a sandbox worker", "call the tool through Sandbox.call")
    data = memoryview(wire.encode(frame))
    while data:
        data = data[os.write(_descriptor[0], data) :]


def progress(event: Mapping[str, Any]) -> None:
    """Report ``event`` (plain JSON) at once; the host keeps it even if this process dies right after."""
    sys.stdout.flush()  # what was printed before belongs before
    send({"kind": "event", "event": event})
