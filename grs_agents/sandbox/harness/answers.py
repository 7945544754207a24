"""Answers of a worker that reads strangers' bytes: plain JSON, bytes beside it in pieces, or the user's error."""

import base64
from collections.abc import Callable
from typing import Any

from grs_agents.base.errors import InputError
from grs_agents.sandbox.harness.channel import report_progress

_PIECE = 3 << 20
"""Bytes of a piece; a whole picture as a single line of JSON would be held four times."""


def send_blob(name: str, data: bytes | memoryview) -> None:
    """Send bytes beside the answer; the host has them under ``name``."""
    whole = memoryview(data).cast("B")
    for start in range(0, max(len(whole), 1), _PIECE):
        report_progress({"blob": name, "data": base64.b64encode(whole[start : start + _PIECE]).decode("ascii")})


def answer_or_refuse(read: Callable[[], dict[str, Any]]) -> dict[str, Any]:
    """The result of ``read`` as an answer; if it refuses its input, the message of its InputError."""
    try:
        return {"answer": read()}
    except InputError as error:
        return {"refused": type(error).__name__, "message": error.message, "remedy": error.remedy}
