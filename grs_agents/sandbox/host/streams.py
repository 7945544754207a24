"""The host's end of a call: send the request, read the worker's output up to a bound, leave nothing of it."""

import json
import os
import select
import selectors
import signal
import socket
import time
from contextlib import suppress
from dataclasses import dataclass
from typing import Any, cast

from grs_agents.sandbox.host.zygote_process import DOCTOR, END_SECONDS, START_SECONDS, SandboxError, Zygote
from grs_agents.sandbox.isolation.backends import LAYERS
from grs_agents.sandbox.isolation.resource_usage import ENTRY_BYTES
from grs_agents.sandbox.protocol import wire
from grs_agents.sandbox.protocol.report import CallOutcome, CallResult, Limits
from grs_agents.sandbox.protocol.startup import EXPLAIN
from grs_agents.sandbox.protocol.tracebacks import MAX_MESSAGE, MAX_TRACEBACK

_KEPT_OUTPUT = 64 << 10
EXPLAIN_SECONDS = 1.0

Ending = tuple[CallOutcome, dict[str, Any] | None, str]
"""Outcome, value and error of a call, according to the pipes."""


@dataclass(frozen=True)
class Exit:
    """The end of a child, as the zygote reports it."""

    status: int  # its wait status
    cpu_seconds: float  # the processor time of its call, without that of its imports
    stopped: str  # the limit that the zygote saw broken, or the empty string


class Streams:
    """Output of a worker; close it to close all given descriptors. ``faulthandler`` writes to ``trace``; the zygote
    reports the end of the worker on ``control``."""

    def __init__(self, frames: socket.socket, trace: int, output: int, control: socket.socket) -> None:
        self.events: list[dict[str, Any]] = []
        self.exit: Exit | None = None
        self._reader = wire.FrameReader()
        self._frames, self._control = frames, control
        self._kept = {"output": bytearray(), "trace": bytearray()}
        self._total = 0
        self._cpu_before = 0.0
        self._names = {"frames": frames.fileno(), "trace": trace, "output": output, "control": control.fileno()}
        self._selector = selectors.DefaultSelector()
        for name, descriptor in self._names.items():
            self._selector.register(descriptor, selectors.EVENT_READ, name)
        for descriptor in (trace, output):
            os.set_blocking(descriptor, False)

    def attach_frame_key(self, request: dict[str, Any]) -> dict[str, Any]:
        """``request`` with the ``key`` that every frame from now on must be sealed with; send it at once."""
        key = wire.new_key()
        self._reader.require_key(bytes.fromhex(key))
        return {**request, "key": key}

    def read_until_answer(self, deadline: float, most: int, until_ready: bool = False) -> Ending | None:
        """Read until the answer, the deadline (monotonic) or ``most`` bytes; None if the worker ended by itself."""
        if (early := self._interpret_new_frames(until_ready)) is not None:
            return early
        while (left := deadline - time.monotonic()) > 0:
            ready = {cast(str, key.data) for key, _ in self._selector.select(left)}
            for name in ("output", "trace", "frames", "control"):  # the answer last: earlier output is kept
                if name not in ready:
                    continue
                ending = self._read_and_interpret_stream(name, until_ready)
                if ending is not None or (name == "control" or (name == "frames" and not self._is_pipe_open("frames"))):
                    return ending
            if self._total > most:
                return "output_limit", None, ""
        return "timeout", None, ""

    def _read_and_interpret_stream(self, name: str, until_ready: bool) -> Ending | None:
        if name == "control":
            self._receive_exit_report()
        data = self._read_stream("frames" if name == "control" else name)
        if name in self._kept:
            self._kept[name] = (self._kept[name] + data)[-_KEPT_OUTPUT:]
            return None
        return self._interpret_new_frames(until_ready, data)

    def _interpret_new_frames(self, until_ready: bool, data: bytes = b"") -> Ending | None:
        """Interpret the available frames, up to a frame that ends the listening; later frames wait."""
        try:
            for frame in self._reader.iterate_frames(data):
                ending = self._interpret_frame(frame, until_ready)
                if ending is not None:
                    self._read_and_interpret_stream("output", False)
                    return ending
        except wire.ForgedFrameError as error:
            return "forged", None, f"something other than the harness wrote to its pipe: {error}"
        except wire.FrameError as error:
            return "error", None, f"the worker sent a malformed frame: {error}"
        return None

    def _interpret_frame(self, frame: dict[str, Any], until_ready: bool) -> Ending | None:
        kind, value = frame.get("kind"), frame.get("value", frame.get("event"))
        if until_ready:
            self._cpu_before = float(frame.get("cpu_seconds", 0.0))
            return (
                ("ok", None, "") if kind == "ready" else ("error", None, str(frame.get("error", frame))[:MAX_MESSAGE])
            )
        if kind == "event" and isinstance(value, dict):
            self.events.append(cast(dict[str, Any], value))
            self._read_and_interpret_stream("output", False)
            self._kept["output"].clear()
            return None
        if kind == "result" and isinstance(value, dict):
            return "ok", cast(dict[str, Any], value), ""
        if kind == "error" and frame.get("outcome") in ("error", "memory_limit"):
            return cast(CallOutcome, frame["outcome"]), None, str(frame.get("error", ""))[-MAX_TRACEBACK:]
        return "error", None, f"the worker sent an unknown frame: {str(frame)[:200]}"

    def _receive_exit_report(self) -> None:
        data = b""
        with suppress(OSError):
            data = self._control.recv(1 << 16)
        self._selector.unregister(self._names["control"])
        if data:
            report = json.loads(data)
            self.exit = Exit(**{**report, "cpu_seconds": report["cpu_seconds"] - self._cpu_before})

    def _read_stream(self, name: str) -> bytes:
        if not self._is_pipe_open(name):
            return b""
        try:
            data = os.read(self._names[name], 1 << 20)
        except BlockingIOError:
            return b""
        except ConnectionResetError:  # it ended with our request half read
            data = b""
        self._total += len(data)
        if not data:
            self._selector.unregister(self._names[name])
        return data

    def _is_pipe_open(self, name: str) -> bool:
        return self._names[name] in self._selector.get_map()

    def end_worker(self, seconds: float, explained: bool = False) -> Exit | None:
        """Kill the worker, if it still runs. Returns: its end, or None if the zygote does not report in time.
        ``explained`` lets the worker write its stack first; a worker that blocks signals is given a second."""
        if explained and self.exit is None and self._is_pipe_open("control"):
            with suppress(OSError):
                self._control.send(EXPLAIN)
                select.select([self._control], [], [], EXPLAIN_SECONDS)
        if self.exit is None and self._is_pipe_open("control"):
            with suppress(OSError):
                self._control.shutdown(socket.SHUT_WR)
                self._control.settimeout(seconds)
            self._receive_exit_report()
        for name in ("output", "trace"):
            self._read_and_interpret_stream(name, False)
        return self.exit

    def captured_text(self, name: str) -> str:
        """Text written to ``output`` or ``trace``."""
        return self._kept[name].decode("utf-8", "replace")

    def close(self) -> None:
        self._selector.close()
        self._frames.close()
        self._control.close()
        for name in ("output", "trace"):
            os.close(self._names[name])


def run_call_in_child(zygote: Zygote, slot: int, frame: dict[str, Any], limits: Limits) -> CallResult | None:
    """Run a call in a child of ``zygote``; None if the zygote ended before the call did.
    ``SandboxError`` if the child could not be made ready: no generated code has run."""
    frames, frames_end = socket.socketpair()
    trace, trace_end = os.pipe()
    output, output_end = os.pipe()
    control, control_end = socket.socketpair()
    streams = Streams(frames, trace, output, control)
    try:
        try:
            ends = (frames_end.fileno(), trace_end, output_end, control_end.fileno())
            ordered = zygote.send_order(slot, limits, ends)
        finally:
            frames_end.close()
            control_end.close()
            os.close(trace_end)
            os.close(output_end)
        data = wire.encode(streams.attach_frame_key(frame))
        if not (ordered and _send_request(frames, data) and _await_worker_ready(streams)):
            return None
        started = time.monotonic()
        ending = streams.read_until_answer(started + limits.wall_seconds, limits.output_mib << 20)
        seconds = time.monotonic() - started
        ended = streams.end_worker(END_SECONDS, explained=ending is not None and ending[0] == "timeout")
        if ended is None:
            zygote.kill()
            return None
        outcome, value, error = ending or (None, None, "")
        if ended.stopped:  # even if a result came first: their order is a race
            outcome, value, error = ended.stopped, None, ""
        elif outcome is None:
            outcome, value, error = _explain_exit(ended, limits)
        message = error or (
            ""
            if outcome == "ok"
            else (
                {
                    "timeout": f"no result within the wall limit of {limits.wall_seconds:g} s",
                    "cpu_limit": f"the CPU limit of {limits.cpu_seconds:g} s was reached",
                    "memory_limit": f"the memory limit of {limits.memory_mib} MiB was reached",
                    "output_limit": f"more than {limits.output_mib} MiB of output",
                    "scratch_limit": f"the scratch folder held more than {limits.scratch_mib} MiB "
                    f"(each entry counts {ENTRY_BYTES >> 10} KiB)",
                    "thread_limit": f"more than {limits.threads} threads",
                }.get(outcome, "the tool failed")
            )
        )
        answer = {"outcome": outcome, "value": value, "error": message, "events": tuple(streams.events)}
        written = {"output": streams.captured_text("output"), "stack": streams.captured_text("trace")}
        spent = {"seconds": seconds, "cpu_seconds": ended.cpu_seconds, "backend": LAYERS[zygote.backend]}
        return CallResult.model_validate({**answer, **written, **spent})
    finally:
        streams.close()


def _send_request(frames: socket.socket, data: bytes) -> bool:
    frames.settimeout(START_SECONDS)
    try:
        frames.sendall(data)
    except OSError:
        return False
    return True


def _await_worker_ready(streams: Streams) -> bool:
    """Wait until the child has given up its rights; False if the zygote ended meanwhile."""
    ready = streams.read_until_answer(time.monotonic() + START_SECONDS, 8 << 20, until_ready=True)
    if ready is not None and ready[0] == "ok":
        return True
    ended = streams.end_worker(END_SECONDS)
    if ended is None:
        return False
    why = ready[2] if ready else f"it ended with wait status {ended.status}"
    raise SandboxError(f"the worker could not be made ready: {why}", DOCTOR)


def _explain_exit(ended: Exit, limits: Limits) -> Ending:
    """Outcome of a worker that ended without an answer, from its wait status."""
    code = os.waitstatus_to_exitcode(ended.status)
    if code == -signal.SIGXCPU or (code == -signal.SIGKILL and ended.cpu_seconds >= limits.cpu_seconds):
        return "cpu_limit", None, ""
    if code < 0:
        name = next((known.name for known in signal.Signals if known == -code), f"signal {-code}")
        return "crashed", None, f"the process was killed by {name}"
    return "crashed", None, f"the process ended itself with exit status {code}"
