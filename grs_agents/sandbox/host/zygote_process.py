"""The host's end of a zygote: start it, have it serve calls, end it."""

import os
import signal
import socket
import subprocess
import sys
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from grs_agents.base.errors import GrsError
from grs_agents.sandbox.isolation import allowlist, backends, command_lines
from grs_agents.sandbox.isolation.backends import Backend
from grs_agents.sandbox.protocol import startup, wire
from grs_agents.sandbox.protocol.report import Limits
from grs_agents.sandbox.protocol.scratch_folders import Scratch
from grs_agents.sandbox.protocol.startup import ENVIRONMENT, Settings

START_SECONDS = 60.0
END_SECONDS = 15.0
DOCTOR = "see `grs doctor`"
"""Remedy for faults that only a check of the whole machine explains."""


class SandboxError(GrsError):
    """No worker could be started: our own failure, never that of generated code."""


@dataclass(frozen=True)
class ZygoteSpec:
    """Requirements of a zygote."""

    # preload, tools: imported before the first call
    preload: tuple[str, ...]
    tools: tuple[str, ...]
    limits: Limits  # of a call; scratch folders have this size
    slots: int  # calls that may run at once
    readable: tuple[Path, ...]  # files and folders that workers may read beside those they need to run
    writable: tuple[Path, ...] = ()  # folders that they may write to beside their scratch folders


class Zygote:
    """A process that has a child, forked or started ahead, for each call; ``SandboxError`` if it cannot be started.
    ``calls`` counts running calls; ``lost`` is set if it ended during a call."""

    def __init__(self, backend: Backend, spec: ZygoteSpec) -> None:
        self.backend: Backend = backend
        self.calls, self.lost = 0, False
        self.readable = allowlist.outermost_paths((*allowlist.runtime_paths(), *spec.readable))
        self._ready = False
        self._scratch = Scratch()
        self._host, theirs = socket.socketpair()
        try:
            self._process = self._start_process(spec, theirs.fileno())
        except OSError as error:
            self._host.close()
            self._scratch.remove()
            raise SandboxError(f"cannot start {sys.executable}: {error}", "free processes or memory") from error
        finally:
            theirs.close()

    @property
    def _log_path(self) -> Path:
        return self._scratch.path / "log"

    def _start_process(self, spec: ZygoteSpec, channel: int) -> "subprocess.Popen[bytes]":
        sized = self.backend == "bubblewrap"
        folders = [self._scratch.path / str(slot) for slot in range(spec.slots)]
        for folder in folders:
            folder.mkdir(mode=0o700)
        confined = self.backend == "sandbox-exec"
        # neither macOS's sandbox nor its libraries bear forks
        single_use = folders if confined or sys.platform == "darwin" else []
        wrapping = [
            command_lines.seatbelt_command_prefix(self.readable, slot_folder, spec.writable) if confined else ()
            for slot_folder in single_use
        ]
        settings = Settings(
            preload=spec.preload,
            overlays=tuple(allowlist.content_overlays()),
            tools=spec.tools,
            layers=self.backend != "none" and sys.platform == "linux",
            readable=(*allowlist.system_paths(), *allowlist.kernel_paths(), *self.readable),
            writable=spec.writable,
            scratch=backends.SCRATCH if sized else self._scratch.path,
            slots=spec.slots,
            scratch_is_sized=sized,
            scratch_bytes=spec.limits.scratch_mib << 20,
            single_use=tuple(map(tuple, wrapping)),
        )
        command = startup.build_command_line("zygote", channel, settings)
        if self.backend == "bubblewrap":
            scratch = [settings.scratch / str(slot) for slot in range(spec.slots)]
            prefix = command_lines.bubblewrap_command_prefix(
                self.readable, scratch, settings.scratch_bytes, spec.writable
            )
            command = [*prefix, *command]
        with self._log_path.open("wb") as log:
            return subprocess.Popen(
                command,
                stdin=subprocess.DEVNULL,
                stdout=log,
                stderr=log,
                cwd="/",
                env=ENVIRONMENT,
                pass_fds=(channel,),
                start_new_session=True,
            )

    def await_ready(self) -> None:
        """Wait until its imports are done; ``SandboxError`` if they failed, or took longer than a minute."""
        if self._ready:
            return
        with suppress(OSError):
            self._host.settimeout(START_SECONDS)
            self._ready = self._host.recv(len(wire.READY)) == wire.READY
        if not self._ready:
            why = (self._log_path.read_text("utf-8", "replace").strip().splitlines() or ["it does not say why"])[-1]
            raise SandboxError(f"the sandbox did not start: {why}", DOCTOR)

    def send_order(self, slot: int, limits: Limits, descriptors: Sequence[int]) -> bool:
        """Have a call served with ``descriptors`` (frames, trace, output, control); False if the zygote is dead."""
        try:
            wire.send_order(self._host, wire.CallOrder(slot=slot, limits=limits), descriptors)
        except OSError:
            return False
        return True

    def kill(self) -> None:
        """End it at once, whatever state it is in. Safe to repeat."""
        if self._process.returncode is None:
            for kill in (os.killpg, os.kill):
                with suppress(ProcessLookupError, PermissionError):
                    kill(self._process.pid, signal.SIGKILL)

    def close(self) -> None:
        """Let it end its children and itself; nothing of it is left afterwards. Safe to repeat."""
        if self._host.fileno() == -1:
            return
        self._host.close()
        try:
            self._process.wait(END_SECONDS)
        except subprocess.TimeoutExpired:
            self.kill()
            self._process.wait()
        self._scratch.remove()
