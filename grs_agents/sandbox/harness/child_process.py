"""The process of a single call: takes the request, gives up every right it can, runs the tool, reports."""

import faulthandler
import fcntl
import gc
import importlib
import json
import math
import os
import signal
import sys
import tempfile
import time
import traceback
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any, NoReturn

from grs_agents.base import content
from grs_agents.sandbox.harness import channel
from grs_agents.sandbox.harness.captured_error import CapturedError
from grs_agents.sandbox.isolation import kernel
from grs_agents.sandbox.isolation.hardening import (
    HardeningError,
    create_file_rules,
    harden_process,
    prepare_hardening_before_fork,
)
from grs_agents.sandbox.isolation.privileges import Allowance, set_resource_limits
from grs_agents.sandbox.protocol import startup, wire
from grs_agents.sandbox.protocol.report import Limits
from grs_agents.sandbox.protocol.startup import Settings
from grs_agents.sandbox.protocol.tracebacks import MAX_TRACEBACK

_DESCRIPTORS = 128
_FRAMES, _TRACE = 3, 4
_PDEATHSIG = 1
_GRACE_SECONDS = 60
_PROMISED = ("landlock", "no capabilities", "seccomp")


def warm_up(settings: Settings) -> None:
    """Import the modules of the settings ahead of any order, and do the work that all children share."""
    for name in settings.preload:
        module, _, call = name.partition(":")
        function, _, arguments = call.partition(":")
        loaded = importlib.import_module(module)
        if function:
            getattr(loaded, function)(*json.loads(arguments or "[]"))
    for folder in settings.overlays:
        content.add_overlay_folder(folder)
    content.installed_content_folders()  # kept: it reads the entry points of every installed package
    for name in settings.tools:
        content.load_module("tools", name)
    if settings.layers:
        prepare_hardening_before_fork()


def create_worker_file_rules(settings: Settings, scratch: Path) -> int | None:
    """File rules, as ``harden_process`` takes them, of a process that works in ``scratch``; forked processes inherit
    them."""
    return (
        create_file_rules(settings.readable, (scratch, *settings.writable, Path(os.devnull)))
        if settings.layers
        else None
    )


def serve_request(
    frames: int, trace: int, output: int, scratch: Path, limits: Limits, settings: Settings, rules: int | None
) -> NoReturn:
    """Serve a single request in this process, which was forked or started for it alone, and end it."""
    with suppress(BaseException):
        zygote, before = os.getppid(), time.process_time()
        rules = _close_other_descriptors(frames, trace, output, rules)
        if sys.platform == "linux":  # have the kernel kill this process when the zygote ends
            kernel.prctl(_PDEATHSIG, signal.SIGKILL)
            if os.getppid() != zygote:  # the zygote ended before the kernel was asked
                os._exit(0)
        else:  # no other kernel takes such an order: at least nothing stays for good
            signal.alarm(math.ceil(limits.wall_seconds) + _GRACE_SECONDS)
        os.setsid()
        signal.set_wakeup_fd(-1)
        for number in (signal.SIGINT, signal.SIGTERM, signal.SIGCHLD):
            signal.signal(number, signal.SIG_DFL)
        with suppress(OSError):  # if memory runs out altogether, this process is killed first
            kernel.write_kernel_file("/proc/self/oom_score_adj", b"1000")
        os.environ["HOME"] = os.environ["TMPDIR"] = str(scratch)
        tempfile.tempdir = None
        os.chdir(scratch)
        reader, frame = wire.FrameReader(), None
        while frame is None and (data := os.read(_FRAMES, 1 << 16)):
            frame = next(iter(reader.feed(data)), None)
        if frame is not None:
            channel.connect(_FRAMES, frame.pop("key"))
            _load_and_run_tool(frame, limits, settings, rules, before)
    os._exit(0)


def _load_and_run_tool(
    frame: dict[str, Any], limits: Limits, settings: Settings, rules: int | None, before: float
) -> None:
    with CapturedError() as captured:
        for folder in frame["overlays"]:
            content.add_overlay_folder(Path(folder))
        module, tool = frame["module"], frame["tool"]
        inside = (importlib.import_module(module) if module else content.load_module("tools", tool)).inside
        _confine_process(limits, settings, rules)
        # Write the stack to the trace pipe on a crash, at the CPU limit and when the host asks, which is the end too.
        faulthandler.enable(file=_TRACE, all_threads=False)
        faulthandler.register(signal.SIGXCPU, file=_TRACE, all_threads=False, chain=True)
        channel.send({"kind": "ready", "cpu_seconds": before})
        _run_tool_and_send_result(inside, frame.pop("request"))
    if captured.error is not None:
        channel.send({"kind": "broken", "error": f"{type(captured.error).__name__}: {captured.error}"})


def _close_other_descriptors(frames: int, trace: int, output: int, rules: int | None) -> int | None:
    """Close all descriptors of the zygote that this process does not need. Returns: the new descriptor of ``rules``."""
    kept = [os.open(os.devnull, os.O_RDONLY), output, output, frames, trace]
    if rules is not None:
        kept.append(rules)
    high = [fcntl.fcntl(descriptor, fcntl.F_DUPFD, _DESCRIPTORS) for descriptor in kept]
    for number, descriptor in enumerate(high):
        os.dup2(descriptor, number)
    os.closerange(len(high), max(high) + 1 + _DESCRIPTORS)
    return None if rules is None else len(high) - 1


def _confine_process(limits: Limits, settings: Settings, rules: int | None) -> None:
    """Give up every right that the tool does not need; an error if a layer that was promised does not hold."""
    allowance = Allowance(limits.cpu_seconds, limits.memory_mib, limits.scratch_mib, _DESCRIPTORS, limits.threads)
    if not settings.layers:
        set_resource_limits(allowance, alone=False)
        return
    layers = harden_process(rules, allowance, visible=not settings.scratch_is_sized)
    if rules is not None:
        os.close(rules)
    missing = [name for name in _PROMISED if not any(layer.startswith(name) for layer in layers)]
    if missing:
        raise HardeningError(f"this kernel has no {' and no '.join(missing)}", "see `grs doctor`")


def _run_tool_and_send_result(inside: Callable[[dict[str, Any]], object], request: dict[str, Any]) -> None:
    with CapturedError() as captured:
        value = inside(request)
        sys.stdout.flush()
        sys.stderr.flush()
        if not isinstance(value, dict):
            raise TypeError(f"a tool returns a dict, not {type(value).__name__}")
        channel.send({"kind": "result", "value": value})
    if isinstance(captured.error, MemoryError):
        traceback.clear_frames(captured.error.__traceback__)  # their local variables keep the memory alive
        channel.send({"kind": "error", "outcome": "memory_limit", "error": ""})
    elif captured.error is not None:
        text = "".join(traceback.format_exception(captured.error))
        channel.send({"kind": "error", "outcome": "error", "error": text[-MAX_TRACEBACK:]})


def main() -> None:
    """Entry of a process for a single call, started by ``zygote.Spawned``: import, wait for the order, serve it.

    It begins under the system's sandbox, so that even its imports have no more rights than the code that it will run.
    """
    zygote, settings = startup.read_startup_arguments()
    warm_up(settings)
    gc.enable()
    with suppress(OSError):
        with suppress(OSError):  # the order may have come already, from a zygote that does not listen any more
            zygote.send(wire.READY)
        if (received := wire.receive_order(zygote, 3)) is not None:
            order, (frames, trace, output) = received
            scratch = settings.scratch / str(order.slot)
            serve_request(
                frames, trace, output, scratch, order.limits, settings, create_worker_file_rules(settings, scratch)
            )
    os._exit(0)
