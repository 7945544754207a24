"""Connections, to servers of the test alone."""

import contextlib
import ctypes
import errno
import os
import socket
import threading
from collections.abc import Callable
from typing import Any

from tests.sandbox.attacks.kit import REFUSED, World, call, check, gets, libc, succeeded

NO_NETWORK = (*REFUSED, "EAFNOSUPPORT")


@gets(*NO_NETWORK)
def tcp(world: World) -> int:
    with socket.create_connection(("127.0.0.1", world["tcp"]), timeout=1) as stream:
        return stream.send(b"x")


def address(port: int) -> bytes:
    """``sockaddr_in`` of a loopback port."""
    return socket.AF_INET.to_bytes(2, "little") + port.to_bytes(2, "big") + bytes((127, 0, 0, 1)) + bytes(8)


@gets(*NO_NETWORK, cases={"plain": 0, "multipath": 262, "SMC": 256})
def tcp_past_python(world: World, protocol: int) -> int:
    family = 43 if protocol == 256 else socket.AF_INET
    descriptor = check(libc.socket(family, socket.SOCK_STREAM, 0 if protocol == 256 else protocol))
    return check(libc.connect(descriptor, address(world["tcp"]), 16)) + 1


@gets(*NO_NETWORK)
def tcp_in_the_first_packet(world: World) -> int:
    """Data may travel before any ``connect``."""
    descriptor = check(libc.socket(socket.AF_INET, socket.SOCK_STREAM, 0))
    return check(libc.sendto(descriptor, b"x", 1, 0x20000000, address(world["tcp"]), 16))


@gets(*NO_NETWORK)
def udp(world: World) -> int:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as stream:
        return stream.sendto(b"x", ("127.0.0.1", world["udp"]))


@gets(*NO_NETWORK)
def udp_past_python(world: World) -> int:
    descriptor = check(libc.socket(socket.AF_INET, socket.SOCK_DGRAM, 0))
    return check(libc.sendto(descriptor, b"x", 1, 0, address(world["udp"]), 16))


@gets(*NO_NETWORK)
def a_server_of_its_own(world: World) -> int:
    descriptor = check(libc.socket(socket.AF_INET, socket.SOCK_STREAM, 0))
    check(libc.bind(descriptor, address(0), 16))
    return check(libc.listen(descriptor, 1)) + 1


def unix(path: bytes) -> bytes:
    """``sockaddr_un``."""
    return socket.AF_UNIX.to_bytes(2, "little") + path


@gets(*NO_NETWORK, cases={"stream": "unix", "datagram": "datagram", "abstract": "abstract"})
def unix_socket(world: World, kind: str) -> int:
    """The session bus, the display and many a server listen there."""
    path = (b"\0" if kind == "abstract" else b"") + os.fsencode(world[kind])
    form = socket.SOCK_DGRAM if kind == "datagram" else socket.SOCK_STREAM
    descriptor = check(libc.socket(socket.AF_UNIX, form, 0))
    check(libc.connect(descriptor, unix(path), 2 + len(path)))
    return check(libc.send(descriptor, b"x", 1, 0))


@gets(*NO_NETWORK)
def unix_datagram_without_connecting(world: World) -> int:
    path = os.fsencode(world["datagram"])
    descriptor = check(libc.socket(socket.AF_UNIX, socket.SOCK_DGRAM, 0))
    return check(libc.sendto(descriptor, b"x", 1, 0, unix(path), 2 + len(path)))


_FAMILIES = """
netlink route: 16 3 0, netlink audit: 16 3 9, netlink events: 16 3 15, netlink netfilter: 16 3 12,
netlink crypto: 16 3 21, vsock: 40 1 0, raw ICMP: 2 3 1, ping: 2 2 1, packet: 17 3 768, IPv6: 10 1 0,
SCTP: 2 1 132, kernel crypto: 38 5 0, XDP: 44 3 0, key: 15 3 2, bluetooth: 31 3 1, CAN: 29 3 1, TIPC: 30 1 0,
RDS: 21 5 0, Kernel connection multiplexor: 41 5 0, QIPC: 42 2 0
"""
FAMILIES = {
    name.strip(): tuple(map(int, numbers.split())) for name, numbers in (row.split(":") for row in _FAMILIES.split(","))
}
"""Name to family, type and protocol."""


@gets(*NO_NETWORK, "EPROTONOSUPPORT", "ESOCKTNOSUPPORT", cases=FAMILIES)
def socket_family(world: World, family: tuple[int, ...]) -> int:
    """Each family is code of the kernel, with its own history of faults."""
    return check(libc.socket(*family))


@gets(*REFUSED)
def a_name(world: World) -> Any:
    """Asking for a name sends it away."""
    with contextlib.suppress(socket.gaierror):
        return socket.getaddrinfo("localhost", world["tcp"])
    raise OSError(errno.EPERM, "no answer")


@gets(*REFUSED)
def asynchronous_input(world: World) -> int:
    """``io_uring`` opens files and sockets past every filter of system calls."""
    return call("io_uring_setup", 8, (ctypes.c_uint32 * 30)())


@gets("nothing")
def sockets_left_open(world: World) -> list[str] | None:
    """Nothing that was inherited can be sent on, or hands out other descriptors."""
    attempts: dict[str, Callable[[], Any]] = {}
    for descriptor in range(256):
        attempts[f"{descriptor} connect"] = lambda at=descriptor: check(libc.connect(at, address(world["tcp"]), 16))
        attempts[f"{descriptor} accept"] = lambda at=descriptor: check(libc.accept4(at, None, None, 0x800))
        attempts[f"{descriptor} listen"] = lambda at=descriptor: check(libc.listen(at, 1))
    return succeeded(attempts)


@gets("nothing")
def threads_of_sockets(world: World) -> list[str] | None:
    """A new thread is held by the same rules."""
    found: list[str] = []

    def connect() -> None:
        with contextlib.suppress(OSError):
            found.append(str(tcp.run(world)))

    thread = threading.Thread(target=connect)
    thread.start()
    thread.join()
    return found or None
