"""What a call may cost and what it comes back as."""

from typing import Any, Literal

from grs_agents.base import Frozen
from grs_agents.config import Limits

CallOutcome = Literal[
    "ok", "timeout", "cpu_limit", "memory_limit", "output_limit", "scratch_limit", "thread_limit",
    "crashed", "forged", "error",
]  # fmt: skip
"""``error`` is an exception that left the tool, or a result that is not plain JSON; ``forged`` is a frame that does not
come from the harness."""

EXITED = "the process ended itself"
"""How the error of a ``crashed`` call begins whose process was not killed but exited without an answer."""


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


__all__ = ["EXITED", "CallOutcome", "CallResult", "Limits"]
