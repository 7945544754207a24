"""The child process: imports ahead of time, takes ONE request, applies the limits, runs the tool, reports.

Started by ``process.Worker`` as ``python -c ... RESULT TRACE PRELOAD...`` with the request pipe as standard input.
"""

import faulthandler
import fcntl
import importlib
import math
import os
import resource
import select
import signal
import sys
import time
import traceback
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

from grs_agents import content
from grs_agents.sandbox import channel
from grs_agents.sandbox.call import Limits
from grs_agents.sandbox.caught import Caught
from grs_agents.sandbox.guard import deny_processes_and_network
from grs_agents.sandbox.scratch import remove_folder
from grs_agents.sandbox.wire import FrameReader


def main() -> None:
    """Serve one request and end."""
    result, trace, *preload = sys.argv[1:]
    sys.argv = ["sandbox"]
    requests = _take_request_pipe()
    for name in preload:
        importlib.import_module(name)
    channel.connect(int(result))
    frame = None
    with suppress(BrokenPipeError):
        channel.send({"kind": "ready"})
        frame = _receive(requests)
    if frame is None:  # the host went away, or never needed this worker
        remove_folder(Path.cwd())
        os._exit(0)
    _die_with_host(requests)
    _explain_death(int(trace), frame["limits"]["wall_seconds"])
    for folder in frame["overlays"]:
        content.add_overlay(Path(folder))
    tool = content.load_module("tools", frame["tool"])
    _limit(Limits.model_validate(frame["limits"]))
    deny_processes_and_network()
    _answer(tool.inside, frame["request"])
    os._exit(0)


def _take_request_pipe() -> int:
    """Move the request pipe away from standard input, which becomes empty for the code that runs here."""
    requests = os.dup(0)
    empty = os.open(os.devnull, os.O_RDONLY)
    os.dup2(empty, 0)
    os.close(empty)
    return requests


def _receive(requests: int) -> dict[str, Any] | None:
    reader = FrameReader()
    while data := os.read(requests, 1 << 16):
        if frames := reader.feed(data):
            return frames[0]
    return None


def _die_with_host(requests: int) -> None:
    """Have the kernel end this process group when the host's end of the pipe closes, whatever runs here."""
    signal.signal(signal.SIGIO, signal.SIG_DFL)
    fcntl.fcntl(requests, fcntl.F_SETOWN, -os.getpgrp())
    fcntl.fcntl(requests, fcntl.F_SETFL, fcntl.fcntl(requests, fcntl.F_GETFL) | os.O_ASYNC)
    if select.select([requests], [], [], 0)[0]:  # it closed before the signal was asked for
        os._exit(0)


def _explain_death(trace: int, wall_seconds: float) -> None:
    """Write the stack to ``trace`` on a crash, at the CPU limit and just before the wall limit."""
    faulthandler.enable(file=trace, all_threads=False)
    faulthandler.register(signal.SIGXCPU, file=trace, all_threads=False, chain=True)
    faulthandler.dump_traceback_later(max(wall_seconds - 0.25, wall_seconds * 0.8), file=trace)


def _limit(limits: Limits) -> None:
    cpu = math.ceil(time.process_time() + limits.cpu_seconds)
    resource.setrlimit(resource.RLIMIT_CPU, (cpu, cpu + 1))
    file_size = limits.file_mib << 20
    resource.setrlimit(resource.RLIMIT_FSIZE, (file_size, file_size))
    resource.setrlimit(resource.RLIMIT_NOFILE, (128, 128))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    held = Path("/proc/self/statm")
    if held.exists():  # elsewhere the kernel does not keep a limit on address space
        pages = int(held.read_text().split()[0])
        size = pages * resource.getpagesize() + (limits.memory_mib << 20)
        resource.setrlimit(resource.RLIMIT_AS, (size, size))


def _answer(inside: Callable[[dict[str, Any]], object], request: dict[str, Any]) -> None:
    with Caught() as caught:
        value = inside(request)
        sys.stdout.flush()
        sys.stderr.flush()
        if not isinstance(value, dict):
            raise TypeError(f"a tool returns a dict, not {type(value).__name__}")
        channel.send({"kind": "result", "value": value})
    if isinstance(caught.error, MemoryError):
        traceback.clear_frames(caught.error.__traceback__)  # the memory hangs on their local variables
        channel.send({"kind": "error", "outcome": "memory_limit", "error": ""})
    elif caught.error is not None:
        text = "".join(traceback.format_exception(caught.error))
        channel.send({"kind": "error", "outcome": "error", "error": text[-8000:]})
