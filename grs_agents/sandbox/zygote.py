"""The process that imports once and forks a hardened child for each call; it never runs generated code itself.

Started by ``process.Zygote`` as ``python -c ... SOCKET SETTINGS`` with one end of a socket pair. Each order arrives
with four descriptors: the child's frames, trace and output, and a control socket over which this process tells how
the child ended. When the host closes its end of the control socket, or of the pair, the child is killed.
"""

import gc
import importlib
import json
import os
import selectors
import signal
import socket
import sys
import time
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, cast

from grs_agents.sandbox import child, usage
from grs_agents.sandbox.call import Limits
from grs_agents.sandbox.scratch import empty_folder
from grs_agents.sandbox.settings import EXPLAIN, Settings

WATCH_SECONDS = 0.05
_ORDER_BYTES = 1 << 16


def main() -> None:
    """Import what the settings name, say so, and serve until the host goes away."""
    descriptor, text = sys.argv[1:]
    sys.argv = ["sandbox"]
    settings = Settings.model_validate_json(text)
    host = socket.socket(fileno=int(descriptor))
    for name in settings.preload:
        importlib.import_module(name)
    child.warm(settings)
    gc.collect()
    gc.freeze()  # the children share these pages for as long as no collector touches them
    with suppress(OSError):
        host.send(b"ready")
        _Zygote(host, settings).serve()
    os._exit(0)


@dataclass(eq=False)
class _Running:
    """One call.

    Attributes:
        pid, exit: the child, and a descriptor that becomes readable when it ends.
        control: the socket that the host holds the other end of.
        scratch: the child's folder.
        limits: what it may hold.
        stopped: the limit it broke, as far as this process saw.
    """

    pid: int
    exit: int
    control: socket.socket
    scratch: Path
    limits: Limits
    stopped: str = ""


class _Zygote:
    def __init__(self, host: socket.socket, settings: Settings) -> None:
        self._host = host
        self._settings = settings
        self._running: list[_Running] = []
        self._selector = selectors.DefaultSelector()
        self._selector.register(host, selectors.EVENT_READ)
        self._pause = WATCH_SECONDS
        scratch = [settings.scratch / str(slot) for slot in range(settings.slots)]
        self._rules = [child.rules(settings, folder) for folder in scratch]

    def serve(self) -> None:
        """Fork, watch and reap until the host's end of the pair closes."""
        while True:
            for key, _ in self._selector.select(self._pause if self._running else None):
                running = cast(_Running | None, key.data)
                if running is None:
                    if not self._accept():
                        self._end_all()
                        return
                elif running in self._running and key.fileobj is running.control:
                    self._hear(running)
                elif running in self._running:
                    self._reap(running)
            self._watch()

    def _accept(self) -> bool:
        """Take one order and fork its child; False once the host is gone."""
        data, descriptors, _, _ = socket.recv_fds(self._host, _ORDER_BYTES, 4)
        if not data:
            return False
        order = cast(dict[str, Any], json.loads(data))
        limits = Limits.model_validate(order["limits"])
        slot = int(order["slot"])
        scratch = self._settings.scratch / str(slot)
        frames, trace, output, control = descriptors
        pid = os.fork()
        if pid == 0:
            child.serve(frames, trace, output, scratch, limits, self._settings, self._rules[slot])
        for descriptor in (frames, trace, output):
            os.close(descriptor)
        running = _Running(pid, os.pidfd_open(pid), socket.socket(fileno=control), scratch, limits)
        self._running.append(running)
        self._selector.register(running.exit, selectors.EVENT_READ, running)
        self._selector.register(running.control, selectors.EVENT_READ, running)
        return True

    def _hear(self, running: _Running) -> None:
        """The host wants to know where the child is, or wants no more of it, or is gone."""
        with suppress(OSError):
            if running.control.recv(64) == EXPLAIN:
                os.kill(running.pid, signal.SIGXCPU)  # not reaped yet, so the number cannot belong to anybody else
                return
        self._selector.unregister(running.control)
        os.kill(running.pid, signal.SIGKILL)

    def _reap(self, running: _Running) -> None:
        """Take the child's status, empty its scratch folder and tell the host."""
        _, status, used = os.wait4(running.pid, 0)
        stopped = running.stopped or ("scratch_limit" if self._holds_too_much(running) else "")
        empty = _empty(running.scratch)
        self._running.remove(running)
        self._selector.unregister(running.exit)
        os.close(running.exit)
        with suppress(KeyError):
            self._selector.unregister(running.control)
        report = {"status": status, "cpu_seconds": used.ru_utime + used.ru_stime, "stopped": stopped, "empty": empty}
        with suppress(OSError):
            running.control.send(json.dumps(report).encode())
        running.control.close()

    def _watch(self) -> None:
        """Kill what holds more threads or scratch than it may; look less often where looking takes long."""
        begin = time.monotonic()
        for running in self._running:
            if not running.stopped:
                if usage.threads(running.pid) > running.limits.threads:
                    running.stopped = "thread_limit"
                elif self._holds_too_much(running):
                    running.stopped = "scratch_limit"
                if running.stopped:
                    os.kill(running.pid, signal.SIGKILL)
        self._pause = max(WATCH_SECONDS, 10 * (time.monotonic() - begin))

    def _holds_too_much(self, running: _Running) -> bool:
        most = running.limits.scratch_mib << 20
        if self._settings.scratch_is_sized:
            return usage.file_system_bytes(running.scratch) >= min(most, self._settings.scratch_bytes)
        return usage.scratch_bytes(running.scratch, most) >= most

    def _end_all(self) -> None:
        for running in self._running:
            os.kill(running.pid, signal.SIGKILL)
        for running in self._running:
            os.waitpid(running.pid, 0)
            _empty(running.scratch)


def _empty(folder: Path) -> bool:
    """Delete what is in ``folder``; whether it is empty now."""
    empty_folder(folder)
    return not any(folder.iterdir())
