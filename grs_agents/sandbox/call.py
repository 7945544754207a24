"""What a call may cost and what it comes back as."""

from typing import Any, Literal

from pydantic import Field

from grs_agents.base import Frozen

CallOutcome = Literal[
    "ok", "timeout", "cpu_limit", "memory_limit", "output_limit", "scratch_limit", "thread_limit", "crashed", "error"
]
"""``error`` is an exception that left the tool, or a result that is not plain JSON."""


class Limits(Frozen):
    """What one call may cost; each limit that is reached has an outcome of its own.

    Attributes:
        wall_seconds: from the moment the worker takes the request, kept by the host.
        cpu_seconds: processor time of the worker process, kept by the kernel (whole seconds, rounded up).
        memory_mib: address space on top of what a fresh worker holds.
        scratch_mib: all that is in the scratch folder; each entry counts 4 KiB besides its content.
        output_mib: everything the worker writes: standard output, progress and result together.
        threads: threads of the worker, its first one included.
    """

    wall_seconds: float = Field(default=60, gt=0, le=3600)
    cpu_seconds: float = Field(default=50, gt=0, le=3600)
    memory_mib: int = Field(default=1024, ge=16, le=65536)
    scratch_mib: int = Field(default=64, ge=1, le=4096)
    output_mib: int = Field(default=8, ge=1, le=256)
    threads: int = Field(default=64, ge=1, le=4096)


class CallResult(Frozen):
    """How one call ended.

    Attributes:
        outcome: ``ok``, or what stopped it.
        value: what the tool returned; None unless the outcome is ``ok``.
        error: why there is no value, with the traceback if there is one.
        output: the last 64 KiB written to standard output and standard error since the last event.
        stack: where the code was when it crashed or ran out of time, as ``faulthandler`` writes it.
        events: what the tool reported while it ran, in order.
        seconds: wall time of the call.
        cpu_seconds: processor time of the worker.
        backend: what separated the worker from the host.
        retried: the process that forks the workers was killed during a first try.
    """

    outcome: CallOutcome
    value: dict[str, Any] | None = None
    error: str = ""
    output: str = ""
    stack: str = ""
    events: tuple[dict[str, Any], ...] = ()
    seconds: float = 0.0
    cpu_seconds: float = 0.0
    backend: str = "none"
    retried: bool = False
