"""Client of openpi's policy servers: msgpack over a websocket (extra ``openpi``).

The protocol is that of Physical Intelligence's ``openpi-client`` 0.1, which demands numpy below 2: after the server's
metadata each message is an observation, each reply a mapping with ``actions``; a reply in text is a traceback.
"""

from collections.abc import Mapping
from contextlib import ExitStack
from importlib import import_module
from typing import Any, cast
from urllib.parse import urlsplit

import numpy as np
import numpy.typing as npt

from grs_agents.base.errors import InputError

_LARGEST_REPLY = 64 * 2**20
"""Bytes of a reply: a chunk of actions has some kilobytes."""
_PLAIN_KINDS = "biufSU"
"""Kinds of numpy types that arrays of a reply may have: no objects, which would be unpickled."""


class OpenpiClient:
    """A connection to a server, made when it is first needed.

    Args:
        address: ``ws://HOST:PORT`` or ``wss://HOST:PORT``.
        timeout: of a connection and of each reply, s.
    """

    def __init__(self, address: str, timeout: float) -> None:
        if urlsplit(address).scheme not in ("ws", "wss") or not urlsplit(address).hostname:
            raise InputError(f"{address!r} is no address of a server", "give openpi:ws://HOST:PORT")
        try:
            self._websockets: Any = import_module("websockets.sync.client")
            self._msgpack: Any = import_module("msgpack")
        except ImportError as error:
            raise InputError(f"{error.name} is not installed", 'run: pip install "grs-agents[openpi]"') from error
        self._address, self._timeout = address, timeout
        self._resources = ExitStack()
        self._connection: Any = None
        self.metadata: Mapping[str, Any] = {}

    def connect(self) -> None:
        """Connect unless connected, and read the server's metadata.

        Raises:
            OSError: the server cannot be reached or closes the connection.
            TimeoutError: it does not answer in time.
        """
        if self._connection is not None:
            return
        try:
            self._connection = self._resources.enter_context(
                self._websockets.connect(
                    self._address, compression=None, max_size=_LARGEST_REPLY, open_timeout=self._timeout
                )
            )
            self.metadata = cast("Mapping[str, Any]", self._receive())
        except ValueError as error:
            self.close()
            raise OSError(f"{self._address} does not speak openpi's protocol: {error}") from error
        except BaseException:
            self.close()
            raise

    def infer(self, observation: Mapping[str, Any]) -> Mapping[str, Any]:
        """The server's reply to an observation.

        Raises:
            OSError: the connection is lost.
            TimeoutError: no reply in time; the connection is closed, since the reply may come later.
            ValueError: the reply is an error of the server, or cannot be read.
        """
        self.connect()
        try:
            self._connection.send(self._msgpack.packb(observation, default=_pack_array))
            reply = self._receive()
        except (OSError, TimeoutError):
            self.close()
            raise
        if not isinstance(reply, Mapping):
            raise ValueError(f"the reply is no mapping: {str(reply)[:200]}")
        return cast("Mapping[str, Any]", reply)

    def close(self) -> None:
        """Close the connection, if any."""
        self._connection = None
        self._resources.close()

    def _receive(self) -> Any:
        exceptions: Any = import_module("websockets.exceptions")
        try:
            message = self._connection.recv(self._timeout)
        except TimeoutError as error:
            raise TimeoutError(f"{self._address} gave no reply within {self._timeout:g} s") from error
        except exceptions.WebSocketException as error:
            raise OSError(f"{self._address} closed the connection: {error}") from error
        if isinstance(message, str):
            raise ValueError(f"the server failed: {message.strip().splitlines()[-1][:300] if message.strip() else ''}")
        try:
            return self._msgpack.unpackb(message, object_hook=_unpack_array)
        except Exception as error:  # msgpack raises errors of several kinds, also its own
            raise ValueError(f"the reply is no msgpack: {type(error).__name__}: {error}") from error


def _pack_array(value: Any) -> Any:
    """An array or numpy number as openpi packs it."""
    if isinstance(value, np.ndarray):
        value = cast("npt.NDArray[Any]", value)
        if value.dtype.kind not in _PLAIN_KINDS:
            raise ValueError(f"cannot send an array of {value.dtype}")
        return {b"__ndarray__": True, b"data": value.tobytes(), b"dtype": value.dtype.str, b"shape": value.shape}
    if isinstance(value, np.generic):
        number = cast(Any, value)
        return {b"__npgeneric__": True, b"data": number.item(), b"dtype": number.dtype.str}
    raise ValueError(f"cannot send a {type(value).__name__}")


def _unpack_array(value: dict[Any, Any]) -> Any:
    """The array or number of `_pack_array`."""
    if b"__ndarray__" in value:
        kind = np.dtype(value[b"dtype"])
        if kind.kind not in _PLAIN_KINDS:
            raise ValueError(f"the reply holds an array of {kind}")
        return np.ndarray(buffer=value[b"data"], dtype=kind, shape=value[b"shape"])
    if b"__npgeneric__" in value:
        return np.dtype(value[b"dtype"]).type(value[b"data"])
    return value
