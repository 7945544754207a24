"""Orders: the host tells a zygote, and a zygote a waiting worker, to serve a call, with the descriptors it needs."""

import socket
from collections.abc import Sequence

from grs_agents.base import Frozen
from grs_agents.sandbox.protocol.call import Limits

READY = b"ready"
"""What a zygote and a worker say once their imports are done."""
_BYTES = 1024
"""Every order is padded to so many bytes, since stream sockets, which every system has, keep no borders."""


class Order(Frozen):
    """One call to serve.

    Attributes:
        slot: the number of its scratch folder.
        limits: what it may cost.
    """

    slot: int
    limits: Limits


def send(channel: socket.socket, order: Order, descriptors: Sequence[int]) -> None:
    """Send ``order`` along with copies of ``descriptors``.

    Raises:
        OSError: nobody listens any more.
    """
    socket.send_fds(channel, [order.model_dump_json().encode().ljust(_BYTES)], list(descriptors))


def receive(channel: socket.socket, count: int) -> tuple[Order, list[int]] | None:
    """Wait for the next order and its ``count`` descriptors; None once the other end is closed.

    Raises:
        OSError: the connection broke.
    """
    data, descriptors, _, _ = socket.recv_fds(channel, _BYTES, count)
    while len(data) < _BYTES:
        more = channel.recv(_BYTES - len(data)) if data else b""
        if not more:
            return None
        data += more
    return Order.model_validate_json(data), descriptors
