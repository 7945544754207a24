"""Length-prefixed JSON frames between host and worker, read with suspicion: a worker may send anything.

After its request, a worker's frames are sealed: a frame begins with its number and a tag, keyed BLAKE2b over number and
body. So foreign bytes in the pipe end the call, and become no result.

Orders go from the host to a zygote, and from a zygote to a waiting worker: serve a call, with these descriptors.
"""

import hmac
import json
import math
import re
import secrets
import socket
import struct
from collections.abc import Iterator, Mapping, Sequence
from hashlib import blake2b
from typing import Any, cast

from grs_agents.base import Frozen
from grs_agents.sandbox.protocol.report import Limits

_HEADER = struct.Struct("!I")
_SEAL = struct.Struct("!Q16s")
_ENCODER = json.JSONEncoder(allow_nan=False, ensure_ascii=False)
MAX_BODY = 256 << 20
"""Bytes of the longest frame, the largest output limit there is."""
MAX_MARKS = 500_000
"""Brackets and commas in all frames of a call. Each costs up to 240 bytes of Python (a member of an object), together
120 MB."""
MAX_DEPTH = 64
"""Levels of nesting in a frame. JSON takes 1,000, pydantic and the checkpoint's format give up at 255 and 512."""
_STRING = re.compile(rb'"[^"\\]*+(?:\\.[^"\\]*+)*+"', re.DOTALL)
_NO_MARK = re.compile(rb"[^][{},]+")


class FrameError(ValueError):
    """Bytes that are not a frame of plain JSON."""


class ForgedFrameError(FrameError):
    """A frame that the holder of the key did not send, or not in this place."""


def new_key() -> str:
    """A fresh key for the frames of a call, as hexadecimal digits."""
    return secrets.token_hex(32)


def encode(frame: Mapping[str, Any]) -> bytes:
    """``frame`` as bytes; ``ValueError``, ``TypeError`` or ``RecursionError`` if it is not JSON (NaN, cycles, ...)."""
    body = _ENCODER.encode(frame).encode("utf-8", "replace")
    return _HEADER.pack(len(body)) + body


def sign_frame(plain: bytes, key: bytes, number: int) -> bytes:
    """The result of ``encode``, sealed as frame ``number`` (from 0) of the call that ``key`` was made for."""
    body = plain[_HEADER.size :]
    return _HEADER.pack(_SEAL.size + len(body)) + _SEAL.pack(number, _compute_frame_mac(key, number, body)) + body


def extract_json_punctuation(body: bytes) -> bytes:
    """The brackets and commas of a JSON text outside of its strings: they bound its size before it is parsed."""
    return _NO_MARK.sub(b"", _STRING.sub(b"", body))


def decode(body: bytes, shape: bytes) -> dict[str, Any]:
    """Parse the body of a frame, ``shape`` being its ``extract_json_punctuation``.

    ``FrameError`` if it is not UTF-8, not JSON, not an object, nested too deeply, or has numbers or text that no later
    file can hold.
    """
    depth = deepest = 0
    for mark in shape.replace(b",", b""):
        depth += 1 if mark in b"[{" else -1
        deepest = max(deepest, depth)
    if deepest > MAX_DEPTH:
        raise FrameError(f"not plain JSON: nested more than {MAX_DEPTH} levels deep")
    try:
        text = body.decode("utf-8")
        frame = _DECODER.decode(text)
        if "\\u" in text:
            _ENCODER.encode(frame).encode("utf-8")  # lone surrogates would break every later file
    except (ValueError, RecursionError) as error:
        raise FrameError(f"not plain JSON: {str(error)[:200]}") from error
    if not isinstance(frame, dict):
        raise FrameError(f"a frame is an object, not {type(frame).__name__}")
    return cast(dict[str, Any], frame)


class FrameReader:
    """Cuts a stream of bytes into frames, with at most ``MAX_MARKS`` brackets and commas in all of them."""

    def __init__(self) -> None:
        self._buffer = bytearray()
        self._key: bytes | None = None
        self._number = 0
        self._marks = 0

    def require_key(self, key: bytes) -> None:
        """Take only frames sealed with ``key`` from now on, numbered from 0."""
        self._key, self._number = key, 0

    def feed(self, data: bytes) -> list[dict[str, Any]]:
        """The frames that ``data`` completes; errors as ``frames``."""
        return list(self.iterate_frames(data))

    def iterate_frames(self, data: bytes) -> Iterator[dict[str, Any]]:
        """Yield the frames that ``data`` completes, in order: frames before a faulty frame count.

        Raises:
            ForgedFrameError: a frame with a wrong seal, out of turn, or sent twice.
            FrameError: a body that is not plain JSON. The stream is worthless after either.
        """
        self._buffer += data
        while len(self._buffer) >= _HEADER.size:
            length = cast(int, _HEADER.unpack_from(self._buffer)[0])
            if length > MAX_BODY:  # waiting for its end would swallow all that comes after it
                kind = FrameError if self._key is None else ForgedFrameError
                raise kind(f"a frame of {length} bytes, the most is {MAX_BODY}")
            end = _HEADER.size + length
            if len(self._buffer) < end:
                break
            body = bytes(self._buffer[_HEADER.size : end])
            del self._buffer[:end]
            body = self._verify_and_unwrap(body)
            shape = extract_json_punctuation(body)
            self._marks += len(shape)
            if self._marks > MAX_MARKS:
                raise FrameError(f"the frames of a call hold more than {MAX_MARKS} brackets and commas")
            yield decode(body, shape)

    def _verify_and_unwrap(self, body: bytes) -> bytes:
        """The body of a frame, its seal checked and taken off."""
        if self._key is None:
            return body
        if len(body) < _SEAL.size:
            raise ForgedFrameError(f"frame {self._number} has no seal")
        number, given = _SEAL.unpack_from(body)
        body = body[_SEAL.size :]
        if number != self._number:
            raise ForgedFrameError(f"frame {number} came where frame {self._number} was due")
        if not hmac.compare_digest(given, _compute_frame_mac(self._key, number, body)):
            raise ForgedFrameError(f"frame {number} has a wrong tag")
        self._number += 1
        return body


def _compute_frame_mac(key: bytes, number: int, body: bytes) -> bytes:
    """The 16 bytes that vouch for a frame."""
    return blake2b(number.to_bytes(8, "big") + body, digest_size=16, key=key).digest()


def _parse_bounded_integer(text: str) -> int:
    value = int(text)
    if not -(1 << 63) <= value < 1 << 63:
        raise ValueError(f"{text[:40]} does not fit in 64 bits")
    return value


def _reject_non_json_constant(name: str) -> float:
    raise ValueError(f"{name} is not JSON")


def _parse_finite_float(text: str) -> float:
    value = float(text)
    if not math.isfinite(value):
        raise ValueError(f"{text} is too large")
    return value


_DECODER = json.JSONDecoder(
    parse_constant=_reject_non_json_constant, parse_float=_parse_finite_float, parse_int=_parse_bounded_integer
)


READY = b"ready"
"""Message of a zygote or worker after its imports."""
_BYTES = 1024
"""Size of every order, padded, since stream sockets keep no message boundaries."""


class CallOrder(Frozen):
    """An order to serve a call."""

    slot: int  # the number of its scratch folder
    limits: Limits  # on its cost


def send_order(channel: socket.socket, order: CallOrder, descriptors: Sequence[int]) -> None:
    """Send ``order`` along with copies of ``descriptors``; ``OSError`` if the other end is closed."""
    socket.send_fds(channel, [order.model_dump_json().encode().ljust(_BYTES)], list(descriptors))


def receive_order(channel: socket.socket, count: int) -> tuple[CallOrder, list[int]] | None:
    """Wait for the next order and its ``count`` descriptors; None once the other end is closed."""
    data, descriptors, _, _ = socket.recv_fds(channel, _BYTES, count)
    while len(data) < _BYTES:
        more = channel.recv(_BYTES - len(data)) if data else b""
        if not more:
            return None
        data += more
    return CallOrder.model_validate_json(data), descriptors
