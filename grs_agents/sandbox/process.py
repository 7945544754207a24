"""The host's end of a zygote: start it, have it serve calls, end it."""

import os
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from uuid import uuid4

from grs_agents.errors import GrsError
from grs_agents.sandbox import allowlist, backends, boot, bubblewrap, docker, orders, seatbelt
from grs_agents.sandbox.backends import Backend
from grs_agents.sandbox.call import Limits
from grs_agents.sandbox.scratch import Scratch
from grs_agents.sandbox.settings import ENVIRONMENT, Settings

START_SECONDS = 60.0
END_SECONDS = 15.0
DOCTOR = "see `grs doctor`"
"""The remedy where only a look at the whole machine can tell more."""
_LOOK_SECONDS = 0.1
_EVERY_THREAD = 1 << 16
"""More than a user has: where others' threads count but cannot be seen, the container's own limit binds."""


class SandboxError(GrsError):
    """No worker could be started: our own failure, never that of generated code."""


@dataclass(frozen=True)
class Plan:
    """What a zygote is for.

    Attributes:
        preload, tools: what it imports before the first call.
        limits: what a call may hold; scratch folders have this size.
        slots: how many calls may run at once.
        readable: files and folders that workers may read beside those they need to run.
        image: of the container, if there is one.
    """

    preload: tuple[str, ...]
    tools: tuple[str, ...]
    limits: Limits
    slots: int
    readable: tuple[Path, ...]
    image: str


class Zygote:
    """A process that has a child, forked or started ahead, for each call.

    Args:
        backend: what separates children from this process.
        plan: what it is for.

    Attributes:
        calls: how many calls it is serving.
        lost: whether it ended in the middle of one.

    Raises:
        SandboxError: the system refused the process.
    """

    def __init__(self, backend: Backend, plan: Plan) -> None:
        self.backend: Backend = backend
        self.calls, self.lost = 0, False
        self.readable = allowlist.outermost((*allowlist.runtime_paths(), *plan.readable))
        self._image = plan.image
        self._ready = False
        self._scratch = Scratch()
        self._container = f"grs-{uuid4().hex}" if backend == "docker" else ""
        self._host, theirs = socket.socketpair()
        self._listener: socket.socket | None = None
        address, passed = str(theirs.fileno()), (theirs.fileno(),)
        try:
            if self._container:
                self._listener = self._listen()
                address, passed = str(self._socket), ()
            self._process = self._start(plan, address, passed)
        except OSError as error:
            self._close_sockets()
            self._scratch.remove()
            raise SandboxError(f"cannot start {sys.executable}: {error}", "free processes or memory") from error
        finally:
            theirs.close()

    @property
    def pid(self) -> int:
        """The process that was started, which is bubblewrap's or Docker's client where there is one."""
        return self._process.pid

    @property
    def _socket(self) -> Path:
        return self._scratch.path / "socket" / "zygote"

    @property
    def _log(self) -> Path:
        return self._scratch.path / "log"

    def _start(self, plan: Plan, address: str, passed: Sequence[int]) -> "subprocess.Popen[bytes]":
        settings = self._settings(plan)
        with self._log.open("wb") as log:
            return subprocess.Popen(
                [*self._wrapping(plan, settings), *boot.command("zygote", address, settings)],
                stdin=subprocess.DEVNULL,
                stdout=log,
                stderr=log,
                cwd="/",
                env=None if self._container else ENVIRONMENT,  # Docker's client reads where its engine is
                pass_fds=passed,
                start_new_session=True,
            )

    def _settings(self, plan: Plan) -> Settings:
        sized = self.backend in ("bubblewrap", "docker")
        folders = [self._scratch.path / str(slot) for slot in range(plan.slots)]
        for folder in folders:
            folder.mkdir(mode=0o700)
        single_use: list[tuple[str, ...]] = []
        if backends.is_single_use(self.backend):
            confined = self.backend == "sandbox-exec"
            single_use = [tuple(seatbelt.wrap(self.readable, folder)) if confined else () for folder in folders]
        return Settings(
            preload=plan.preload,
            overlays=tuple(allowlist.overlays()),
            tools=plan.tools,
            layers=backends.has_inner_layers(self.backend),
            readable=(*allowlist.system_paths(), *allowlist.kernel_paths(), *self.readable),
            scratch=backends.SCRATCH if sized else self._scratch.path,
            slots=plan.slots,
            scratch_is_sized=sized,
            scratch_bytes=plan.limits.scratch_mib << 20,
            threads_elsewhere=_EVERY_THREAD if self._container else 0,
            single_use=tuple(single_use),
        )

    def _wrapping(self, plan: Plan, settings: Settings) -> list[str]:
        """What to put before the zygote's command."""
        scratch = [settings.scratch / str(slot) for slot in range(plan.slots)]
        if self.backend == "bubblewrap":
            return bubblewrap.wrap(self.readable, scratch, settings.scratch_bytes)
        if self.backend == "docker":
            mounts = (*self.readable, self._socket.parent)
            return docker.wrap(self._container, plan.image, mounts, scratch, plan.limits)
        return []

    def _listen(self) -> socket.socket:
        self._socket.parent.mkdir(mode=0o700)
        listener = socket.socket(socket.AF_UNIX)
        listener.bind(str(self._socket))
        listener.listen(1)
        listener.settimeout(_LOOK_SECONDS)
        return listener

    def await_ready(self) -> None:
        """Wait until its imports are done.

        Raises:
            SandboxError: they failed, or took longer than a minute.
        """
        if self._ready:
            return
        with suppress(OSError):
            self._accept(time.monotonic() + START_SECONDS)
            self._host.settimeout(START_SECONDS)
            self._ready = self._host.recv(len(orders.READY)) == orders.READY
        if not self._ready:
            log = self._log.read_text("utf-8", "replace").strip()
            why, remedy = docker.explain(log, self._image) if self._container else ("", "")
            why = why or (log.splitlines() or ["it does not say why"])[-1]
            raise SandboxError(f"the sandbox did not start: {why}", remedy or DOCTOR)

    def _accept(self, deadline: float) -> None:
        """Where the zygote connects to this process: wait for it, for as long as there is hope."""
        while self._listener is not None and self._process.poll() is None and time.monotonic() < deadline:
            with suppress(TimeoutError):
                connection, _ = self._listener.accept()
                self._host.close()
                self._host = connection
                self._listener.close()
                self._listener = None

    def order(self, slot: int, limits: Limits, descriptors: Sequence[int]) -> bool:
        """Have a call served with ``descriptors`` (frames, trace, output, control); False if the zygote is dead."""
        try:
            orders.send(self._host, orders.Order(slot=slot, limits=limits), descriptors)
        except OSError:
            return False
        return True

    def kill(self) -> None:
        """End it at once, whatever state it is in. Safe to repeat."""
        if self._process.returncode is None:
            if self._container:
                docker.kill(self._container)
            for kill in (os.killpg, os.kill):
                try:
                    kill(self._process.pid, signal.SIGKILL)
                except (ProcessLookupError, PermissionError):
                    continue

    def close(self) -> None:
        """Let it end its children and itself; nothing of it is left afterwards. Safe to repeat."""
        if self._host.fileno() == -1:
            return
        self._close_sockets()
        try:
            self._process.wait(END_SECONDS)
        except subprocess.TimeoutExpired:
            self.kill()
            self._process.wait()
        self._scratch.remove()

    def _close_sockets(self) -> None:
        self._host.close()
        if self._listener is not None:
            self._listener.close()
