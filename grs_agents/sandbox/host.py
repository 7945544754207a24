"""The host's door: call a tool in a worker and get a value back, whatever the code in it does."""

import threading
import weakref
from collections.abc import Sequence
from typing import Any

from grs_agents import content
from grs_agents.sandbox import wire
from grs_agents.sandbox.call import CallResult, Limits
from grs_agents.sandbox.process import SandboxError, Worker
from grs_agents.sandbox.scratch import sweep


class Sandbox:
    """Runs each call in a fresh child process; one more is kept ready with the imports done.

    Args:
        preload: modules that a worker imports before its request arrives, e.g. ``("mujoco",)``.
        keep_ready: keep one idle worker; without it every call pays for its own start.

    Safe to share between threads. Use it as a context manager, or ``close`` it.
    """

    backend = "process"

    def __init__(self, preload: Sequence[str] = (), keep_ready: bool = True) -> None:
        self._preload = tuple(preload)
        self._keep_ready = keep_ready
        self._idle: list[Worker] = []
        self._lock = threading.Lock()
        sweep()
        weakref.finalize(self, _close_all, self._idle)

    def warm(self) -> None:
        """Start the idle worker now, so that the first call finds it ready."""
        with self._lock:
            if self._keep_ready and not self._idle:
                self._idle.append(Worker(self._preload))

    def call(self, tool: str, request: dict[str, Any], limits: Limits | None = None) -> CallResult:
        """Run ``inside(request)`` of the tool file ``tool`` in a worker.

        Args:
            tool: a name in ``tools/``.
            request: plain JSON.
            limits: what the call may cost; the defaults of ``Limits`` otherwise.

        Raises:
            UnknownNameError: no such tool.
            SandboxError: no worker can be started.
            ValueError: the request is not plain JSON (NaN, infinity).
        """
        content.path("tools", tool)
        limits = limits or Limits()
        frame = {
            "tool": tool,
            "request": request,
            "limits": limits.model_dump(),
            "overlays": [str(root) for root in reversed(content.roots()[:-1])],
        }
        wire.encode(frame)
        for _ in range(2):  # an idle worker may have been killed by the system meanwhile
            result = self._take().run(frame, limits)
            if result is not None:
                return result
        raise SandboxError("two sandbox workers died before they took a request", "see `grs doctor`")

    def close(self) -> None:
        """End the idle worker. A later call starts a new one."""
        with self._lock:
            _close_all(self._idle)

    def __enter__(self) -> "Sandbox":
        return self

    def __exit__(self, *exception: object) -> None:
        self.close()

    def _take(self) -> Worker:
        with self._lock:
            worker = self._idle.pop() if self._idle else Worker(self._preload)
            if self._keep_ready:
                self._idle.append(Worker(self._preload))
            return worker


def _close_all(workers: list[Worker]) -> None:
    while workers:
        workers.pop().close()
