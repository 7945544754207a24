"""Does the sandbox hold? Real attacks, made from inside a worker when a backend is used for the first time."""

import ctypes
import os
import signal
import socket
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

from grs_agents.sandbox.harness.captured_error import CapturedError
from grs_agents.sandbox.host.streams import run_call_in_child
from grs_agents.sandbox.host.zygote_process import DOCTOR, SandboxError, Zygote
from grs_agents.sandbox.isolation import allowlist
from grs_agents.sandbox.protocol.report import Limits

_LIMITS = Limits(wall_seconds=20, cpu_seconds=10, memory_mib=256)


def verify_attacks_fail(zygote: Zygote, slot: int) -> None:
    """Attack from inside a child of ``zygote``; ``SandboxError`` if an attack succeeded or the probe did not run."""
    if zygote.backend == "none":
        return
    with tempfile.TemporaryDirectory(prefix="grs-probe-") as folder, socket.create_server(("127.0.0.1", 0)) as server:
        secret = Path(folder) / "secret"
        secret.write_text("canary", "ascii")
        request = {"secret": str(secret), "port": server.getsockname()[1], "host": os.getpid()}
        frame: dict[str, Any] = {"module": __name__, "tool": None, "request": request, "overlays": []}
        result = run_call_in_child(zygote, slot, frame, _LIMITS)
        changed = secret.read_text("ascii") != "canary" or len(list(Path(folder).iterdir())) != 1
    if result is None or result.value is None:
        why = "it ended" if result is None else f"{result.outcome}: {result.error.strip().splitlines()[-1]}"
        raise SandboxError(f"the probe of the sandbox did not run ({why})", DOCTOR)
    allowed = {"read a file outside"} if allowlist.is_path_covered(secret, zygote.readable) else set[str]()
    escaped = [name for name in result.value["escaped"] if name not in allowed]
    if changed:
        escaped.append("changed a file outside")
    if escaped:
        raise SandboxError(f"a worker {', '.join(escaped)}", DOCTOR)


def inside(request: dict[str, Any]) -> dict[str, Any]:
    """The worker's part: the names of successful attacks."""
    secret, port, host = Path(request["secret"]), int(request["port"]), int(request["host"])
    libc = ctypes.CDLL(None, use_errno=True)
    attempts: dict[str, Callable[[], object]] = {
        "read a file outside": secret.read_bytes,
        "wrote a file outside": lambda: secret.write_text("changed", "ascii"),
        "made a file outside": lambda: (secret.parent / "more").write_text("", "ascii"),
        "sent a datagram": lambda: socket.socket(type=socket.SOCK_DGRAM).sendto(b"", ("127.0.0.1", port)),
        "connected": lambda: socket.create_connection(("127.0.0.1", port), 1),
        "could signal its host": lambda: os.kill(host, 0),
        "could signal its parent": lambda: os.kill(os.getppid(), 0),
        "forked": lambda: _fork_and_kill_child(os.fork),
        "forked through ctypes": lambda: _fork_and_kill_child(lambda: _raise_errno_if_refused(libc.fork())),
        "could run a program": _try_executing_program,
    }
    if sys.platform == "linux":  # macOS allows these harmlessly, or has no such call
        attempts |= {
            "opened a socket": lambda: socket.socket(socket.AF_INET, socket.SOCK_DGRAM),
            "made a namespace": lambda: _raise_errno_if_refused(libc.unshare(0x10000000)),
            "read its parent's environment": Path(f"/proc/{os.getppid()}/environ").read_bytes,
            "became traced": lambda: _raise_errno_if_refused(libc.ptrace(0, 0, 0, 0)),
        }
    escaped: list[str] = []
    for name, attack in attempts.items():
        with CapturedError() as captured:
            attack()
        if captured.error is None:
            escaped.append(name)
    return {"escaped": escaped}


def _try_executing_program() -> None:
    """Ask for a program that does not exist: Linux may say so only to those who may run programs."""
    if sys.platform != "linux":
        os.execv("/usr/bin/true", ["true"])  # on success nobody is left to report, which is noticed as well
    try:
        os.execv("/nonexistent", ["nonexistent"])
    except FileNotFoundError:
        return


def _raise_errno_if_refused(value: int) -> int:
    if value == -1:
        raise OSError(ctypes.get_errno(), "refused")
    return value


def _fork_and_kill_child(fork: Callable[[], int]) -> None:
    pid = fork()
    if pid == 0:
        os._exit(0)
    os.kill(pid, signal.SIGKILL)
    os.waitpid(pid, 0)
