"""Length-prefixed JSON frames between host and worker, read with suspicion: a worker may send anything."""

import json
import math
import struct
from collections.abc import Mapping
from typing import Any, cast

_HEADER = struct.Struct("!I")


class FrameError(ValueError):
    """Bytes that are not a frame of plain JSON."""


def encode(frame: Mapping[str, Any]) -> bytes:
    """``frame`` as bytes.

    Raises:
        ValueError, TypeError, RecursionError: it holds NaN, infinity, cycles or anything that is not JSON.
    """
    body = json.dumps(frame, allow_nan=False, ensure_ascii=False).encode("utf-8", "replace")
    return _HEADER.pack(len(body)) + body


def decode(body: bytes) -> dict[str, Any]:
    """The object in the body of one frame.

    Raises:
        FrameError: not UTF-8, not JSON, not an object, or with numbers or text that JSON cannot carry on.
    """
    try:
        frame = json.loads(body, parse_constant=_refuse, parse_float=_finite)
        json.dumps(frame, ensure_ascii=False).encode("utf-8")  # lone surrogates would break every later file
    except (ValueError, RecursionError) as error:
        raise FrameError(f"not plain JSON: {str(error)[:200]}") from error
    if not isinstance(frame, dict):
        raise FrameError(f"a frame is an object, not {type(frame).__name__}")
    return cast(dict[str, Any], frame)


class FrameReader:
    """Cuts a stream of bytes into frames."""

    def __init__(self) -> None:
        self._buffer = bytearray()

    def feed(self, data: bytes) -> list[dict[str, Any]]:
        """The frames that ``data`` completes.

        Raises:
            FrameError: a body that is not plain JSON. What follows it in the stream is worthless.
        """
        self._buffer += data
        frames: list[dict[str, Any]] = []
        while len(self._buffer) >= _HEADER.size:
            end = _HEADER.size + cast(int, _HEADER.unpack_from(self._buffer)[0])
            if len(self._buffer) < end:
                break
            frames.append(decode(bytes(self._buffer[_HEADER.size : end])))
            del self._buffer[:end]
        return frames


def _refuse(name: str) -> float:
    raise ValueError(f"{name} is not JSON")


def _finite(text: str) -> float:
    value = float(text)
    if not math.isfinite(value):
        raise ValueError(f"{text} is too large")
    return value
