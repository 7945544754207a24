"""What Python code in a worker is told not to do: start processes and open connections.

An audit hook catches the honest mistake with a clear error; it is no wall (``ctypes`` walks around it).
"""

import sys

_DENIED = frozenset(
    {
        "os.exec",
        "os.fork",
        "os.forkpty",
        "os.posix_spawn",
        "os.spawn",
        "os.system",
        "pty.spawn",
        "socket.bind",
        "socket.connect",
        "socket.getaddrinfo",
        "socket.sendmsg",
        "socket.sendto",
        "subprocess.Popen",
    }
)


def deny_processes_and_network() -> None:
    """Make this interpreter refuse both, with ``PermissionError``, for the rest of its life."""
    sys.addaudithook(_refuse)


def _refuse(event: str, arguments: tuple[object, ...]) -> None:
    del arguments
    if event in _DENIED:
        raise PermissionError(f"{event} is not available in the sandbox")
