"""The host's end of one single-use worker: start it, send the request, listen until its end, clear up."""

import os
import signal
import subprocess
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import grs_agents
from grs_agents.errors import GrsError
from grs_agents.sandbox import wire
from grs_agents.sandbox.call import CallOutcome, CallResult, Limits
from grs_agents.sandbox.scratch import Scratch
from grs_agents.sandbox.streams import Ending, Streams

START_SECONDS = 60.0
_BOOT = (
    "import os, sys; paths = sys.argv.pop(1).split(os.pathsep); "
    "sys.path[:0] = [path for path in paths if path not in sys.path]; "
    "from grs_agents.sandbox.worker import main; main()"
)


class SandboxError(GrsError):
    """No worker could be started: our own failure, never that of generated code."""


class Worker:
    """A child process in a session of its own, good for one request.

    Args:
        preload: modules it imports before it waits for the request.

    Raises:
        SandboxError: the system refused the process.
    """

    def __init__(self, preload: Sequence[str]) -> None:
        self.scratch = Scratch()
        result, result_end = os.pipe()
        trace, trace_end = os.pipe()
        descriptors = (str(result_end), str(trace_end))
        command = [sys.executable, "-s", "-P", "-B", "-c", _BOOT, _import_path(), *descriptors, *preload]
        try:
            self._process = subprocess.Popen(
                command,
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=subprocess.STDOUT,
                bufsize=0,
                cwd=self.scratch.path,
                env=_environment(self.scratch.path),
                pass_fds=(result_end, trace_end),
                start_new_session=True,
            )
        except OSError as error:
            os.close(result)
            os.close(trace)
            self.scratch.remove()
            raise SandboxError(f"cannot start {sys.executable}: {error}", "free processes or memory") from error
        finally:
            os.close(result_end)
            os.close(trace_end)
        self._streams = Streams(self._process, result, trace)
        self._usage = 0.0

    def run(self, frame: dict[str, Any], limits: Limits) -> CallResult | None:
        """Send ``frame`` and listen until the worker answers, dies or breaks a limit; then nothing of it is left.

        Returns:
            None if the worker was dead before it took the request.

        Raises:
            SandboxError: the worker cannot start (its imports fail).
        """
        try:
            if not self._await_ready() or not self._send(wire.encode(frame)):
                return None
            started = time.monotonic()
            ending = self._streams.listen(started + limits.wall_seconds, limits.output_mib << 20)
            seconds = time.monotonic() - started
        finally:
            status = self.close()
        outcome, value, error = ending or _explain(status, self._usage, limits)
        return CallResult(
            outcome=outcome,
            value=value,
            error=error or ("" if outcome == "ok" else _broken_limit(outcome, limits)),
            output=self._streams.text("output"),
            stack=self._streams.text("trace"),
            events=tuple(self._streams.events),
            seconds=seconds,
            cpu_seconds=self._usage,
        )

    def close(self) -> int:
        """Kill the process group, reap the worker, delete its scratch folder; its wait status. Safe to repeat."""
        if self._process.returncode is not None:
            return 0
        # The worker is not reaped yet, so its group id cannot belong to anybody else.
        for kill, number in ((os.killpg, self._process.pid), (os.kill, self._process.pid)):
            try:
                kill(number, signal.SIGKILL)
            except (ProcessLookupError, PermissionError):
                continue
        _, status, usage = os.wait4(self._process.pid, 0)
        self._process.returncode = os.waitstatus_to_exitcode(status)
        self._usage = usage.ru_utime + usage.ru_stime
        self._streams.close()
        if self._process.stdin is not None:
            self._process.stdin.close()
        self.scratch.remove()
        return status

    def _await_ready(self) -> bool:
        """Wait for the end of its imports; False if something killed it."""
        ready = self._streams.listen(time.monotonic() + START_SECONDS, 8 << 20, until_ready=True)
        if ready is not None and ready[0] == "ok":
            return True
        status = self.close()
        if ready is None and os.WIFSIGNALED(status):
            return False
        output = self._streams.text("output").strip().splitlines()
        why = output[-1] if output else f"wait status {status}"
        raise SandboxError(f"the sandbox worker did not start: {why}", "see `grs doctor`")

    def _send(self, data: bytes) -> bool:
        view = memoryview(data)
        try:
            while view and self._process.stdin is not None:
                view = view[self._process.stdin.write(view) :]
        except BrokenPipeError:
            return False
        return True


def _import_path() -> str:
    """Where this package lies, be it a source tree or installed, and what the user put on PYTHONPATH."""
    extra = [path for path in os.environ.get("PYTHONPATH", "").split(os.pathsep) if path]
    return os.pathsep.join([str(Path(grs_agents.__file__).parent.parent), *map(os.path.abspath, extra)])


def _environment(scratch: Path) -> dict[str, str]:
    """All that a worker finds in its environment: nothing of the host's."""
    return {
        "HOME": str(scratch),
        "TMPDIR": str(scratch),
        "LC_ALL": "C.UTF-8",
        "PYTHONHASHSEED": "0",  # sets of strings iterate alike in every run
        "MALLOC_ARENA_MAX": "2",
        "OMP_NUM_THREADS": "1",
        "OPENBLAS_NUM_THREADS": "1",
        "PYDANTIC_DISABLE_PLUGINS": "__all__",  # looking for them reads every installed distribution
    }


def _explain(status: int, cpu_seconds: float, limits: Limits) -> Ending:
    """Why a worker ended without an answer."""
    code = os.waitstatus_to_exitcode(status)
    if code == -signal.SIGXCPU or (code == -signal.SIGKILL and cpu_seconds >= limits.cpu_seconds):
        return "cpu_limit", None, ""
    if code < 0:
        return "crashed", None, f"the process was killed by {_signal_name(-code)}"
    return "crashed", None, f"the process ended itself with exit status {code}"


def _signal_name(number: int) -> str:
    try:
        return signal.Signals(number).name
    except ValueError:
        return f"signal {number}"


def _broken_limit(outcome: CallOutcome, limits: Limits) -> str:
    return {
        "timeout": f"no result within the wall limit of {limits.wall_seconds:g} s",
        "cpu_limit": f"the CPU limit of {limits.cpu_seconds:g} s was reached",
        "memory_limit": f"the memory limit of {limits.memory_mib} MiB was reached",
        "output_limit": f"more than {limits.output_mib} MiB of output",
    }.get(outcome, "the tool failed")
