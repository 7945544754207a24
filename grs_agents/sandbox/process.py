"""The host's end of a zygote: start it, have it fork, end it."""

import json
import os
import signal
import socket
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

import grs_agents
from grs_agents.errors import GrsError
from grs_agents.sandbox import allowlist, backends
from grs_agents.sandbox.backends import Backend
from grs_agents.sandbox.call import Limits
from grs_agents.sandbox.scratch import Scratch
from grs_agents.sandbox.settings import Settings

START_SECONDS = 60.0
END_SECONDS = 5.0
_BOOT = (
    "import sys; path = sys.argv.pop(1); path in sys.path or sys.path.insert(0, path); "
    "from grs_agents.sandbox.zygote import main; main()"
)


class SandboxError(GrsError):
    """No worker could be started: our own failure, never that of generated code."""


class Zygote:
    """A process that forks a child for each call.

    Args:
        backend: what separates it from this process.
        preload, tools: what it imports before the first call.
        limits: the size of a scratch folder comes from here.
        slots: how many calls may run at once.
        readable: files and folders that its children may read beside those they need to run.

    Attributes:
        calls: how many calls it is serving.
        lost: whether it ended in the middle of one.

    Raises:
        SandboxError: the system refused the process.
    """

    def __init__(
        self,
        backend: Backend,
        preload: Sequence[str],
        tools: Sequence[str],
        limits: Limits,
        slots: int,
        readable: Sequence[Path],
    ) -> None:
        self.backend: Backend = backend
        self.calls, self.lost = 0, False
        self.readable = allowlist.outermost((*allowlist.runtime_paths(), *readable))
        self._scratch = Scratch()
        self._log = self._scratch.path / "log"
        sized = backend == "bubblewrap"
        settings = Settings(
            preload=tuple(preload),
            tools=tuple(tools),
            layers=backend != "none",
            readable=(*allowlist.system_paths(), *allowlist.kernel_paths(), *self.readable),
            scratch=backends.SCRATCH if sized else self._scratch.path,
            slots=slots,
            scratch_is_sized=sized,
            scratch_bytes=limits.scratch_mib << 20,
        )
        for slot in range(slots):
            (self._scratch.path / str(slot)).mkdir(mode=0o700)
        self._host, ours = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        package = str(Path(grs_agents.__file__).parent.parent)
        python = [sys.executable, "-s", "-P", "-B", "-c", _BOOT, package, str(ours.fileno())]
        command = [*backends.wrap(backend, self.readable, slots, settings.scratch_bytes), *python]
        log = self._log.open("wb")
        try:
            self._process = subprocess.Popen(
                [*command, settings.model_dump_json()],
                stdin=subprocess.DEVNULL,
                stdout=log,
                stderr=log,
                cwd="/",
                env=_environment(),
                pass_fds=(ours.fileno(),),
                start_new_session=True,
            )
        except OSError as error:
            self._host.close()
            self._scratch.remove()
            raise SandboxError(f"cannot start {sys.executable}: {error}", "free processes or memory") from error
        finally:
            log.close()
            ours.close()
        self._ready = False

    @property
    def pid(self) -> int:
        """The process that was started, which under bubblewrap is not the zygote itself."""
        return self._process.pid

    def await_ready(self) -> None:
        """Wait until its imports are done.

        Raises:
            SandboxError: they failed, or took longer than a minute.
        """
        if self._ready:
            return
        self._host.settimeout(START_SECONDS)
        try:
            self._ready = self._host.recv(64) == b"ready"
        except OSError:
            self._ready = False
        if not self._ready:
            lines = self._log.read_text("utf-8", "replace").strip().splitlines() or ["it does not say why"]
            raise SandboxError(f"the sandbox did not start: {lines[-1]}", "see `grs doctor`")

    def fork(self, slot: int, limits: Limits, descriptors: Sequence[int]) -> bool:
        """Have a child forked with ``descriptors`` (frames, trace, output, control); False if the zygote is dead."""
        order = json.dumps({"slot": slot, "limits": limits.model_dump()}).encode()
        try:
            socket.send_fds(self._host, [order], list(descriptors))
        except OSError:
            return False
        return True

    def kill(self) -> None:
        """End it at once, whatever state it is in. Safe to repeat."""
        if self._process.returncode is None:
            for kill in (os.killpg, os.kill):
                try:
                    kill(self._process.pid, signal.SIGKILL)
                except (ProcessLookupError, PermissionError):
                    continue

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


def _environment() -> dict[str, str]:
    """All that a worker finds in its environment: nothing of the host's."""
    return {
        "LC_ALL": "C.UTF-8",
        "PYTHONHASHSEED": "0",  # sets of strings iterate alike in every run
        "MALLOC_ARENA_MAX": "2",
        "OMP_NUM_THREADS": "1",  # a process with threads cannot be forked safely
        "OPENBLAS_NUM_THREADS": "1",
        "PYDANTIC_DISABLE_PLUGINS": "__all__",  # looking for them reads every installed distribution
    }
