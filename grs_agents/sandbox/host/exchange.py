"""The host's end of one call: send the request, listen until its end, have nothing of it left."""

import os
import signal
import socket
import time
from typing import Any

from grs_agents.sandbox.host.streams import Ending, Exit, Streams
from grs_agents.sandbox.host.zygote_process import DOCTOR, END_SECONDS, START_SECONDS, SandboxError, Zygote
from grs_agents.sandbox.isolation.backends import LAYERS
from grs_agents.sandbox.isolation.usage import ENTRY_BYTES
from grs_agents.sandbox.protocol import wire
from grs_agents.sandbox.protocol.call import CallResult, Limits


def exchange(zygote: Zygote, slot: int, frame: dict[str, Any], limits: Limits) -> CallResult | None:
    """Run one call in a child of ``zygote``.

    Returns:
        None if the zygote ended before the call did.

    Raises:
        SandboxError: the child could not be made ready; no generated code has run.
    """
    frames, frames_end = socket.socketpair()
    trace, trace_end = os.pipe()
    output, output_end = os.pipe()
    control, control_end = socket.socketpair()
    streams = Streams(frames, trace, output, control)
    try:
        try:
            ordered = zygote.order(slot, limits, (frames_end.fileno(), trace_end, output_end, control_end.fileno()))
        finally:
            frames_end.close()
            control_end.close()
            os.close(trace_end)
            os.close(output_end)
        if not ordered or not _send(frames, wire.encode(streams.keyed(frame))):
            return None
        if not _await_ready(streams):
            return None
        started = time.monotonic()
        ending = streams.listen(started + limits.wall_seconds, limits.output_mib << 20)
        seconds = time.monotonic() - started
        ended = streams.end(END_SECONDS, explained=ending is not None and ending[0] == "timeout")
        if ended is None:
            zygote.kill()
            return None
        return _result(ending, ended, streams, limits, seconds, LAYERS[zygote.backend])
    finally:
        streams.close()


def _send(frames: socket.socket, data: bytes) -> bool:
    frames.settimeout(START_SECONDS)
    try:
        frames.sendall(data)
    except OSError:
        return False
    return True


def _await_ready(streams: Streams) -> bool:
    """Wait until the child has given up its rights; False if the zygote ended meanwhile."""
    ready = streams.listen(time.monotonic() + START_SECONDS, 8 << 20, until_ready=True)
    if ready is not None and ready[0] == "ok":
        return True
    ended = streams.end(END_SECONDS)
    if ended is None:
        return False
    why = ready[2] if ready else f"it ended with wait status {ended.status}"
    raise SandboxError(f"the worker could not be made ready: {why}", DOCTOR)


def _result(
    ending: Ending | None, ended: Exit, streams: Streams, limits: Limits, seconds: float, backend: str
) -> CallResult:
    outcome, value, error = ending or (None, None, "")
    if ended.stopped:  # also where a result came first: whether one does is a matter of who is quicker
        outcome, value, error = ended.stopped, None, ""
    elif outcome is None:
        outcome, value, error = _explain(ended, limits)
    return CallResult.model_validate(
        {
            "outcome": outcome,
            "value": value,
            "error": error or ("" if outcome == "ok" else _broken_limit(outcome, limits)),
            "output": streams.text("output"),
            "stack": streams.text("trace"),
            "events": tuple(streams.events),
            "seconds": seconds,
            "cpu_seconds": ended.cpu_seconds,
            "backend": backend,
        }
    )


def _explain(ended: Exit, limits: Limits) -> Ending:
    """Why a worker ended without an answer."""
    code = os.waitstatus_to_exitcode(ended.status)
    if code == -signal.SIGXCPU or (code == -signal.SIGKILL and ended.cpu_seconds >= limits.cpu_seconds):
        return "cpu_limit", None, ""
    if code < 0:
        return "crashed", None, f"the process was killed by {_signal_name(-code)}"
    return "crashed", None, f"the process ended itself with exit status {code}"


def _signal_name(number: int) -> str:
    try:
        return signal.Signals(number).name
    except ValueError:
        return f"signal {number}"


def _broken_limit(outcome: str, limits: Limits) -> str:
    return {
        "timeout": f"no result within the wall limit of {limits.wall_seconds:g} s",
        "cpu_limit": f"the CPU limit of {limits.cpu_seconds:g} s was reached",
        "memory_limit": f"the memory limit of {limits.memory_mib} MiB was reached",
        "output_limit": f"more than {limits.output_mib} MiB of output",
        "scratch_limit": f"the scratch folder held more than {limits.scratch_mib} MiB "
        f"(each entry counts {ENTRY_BYTES >> 10} KiB)",
        "thread_limit": f"more than {limits.threads} threads",
    }.get(outcome, "the tool failed")
