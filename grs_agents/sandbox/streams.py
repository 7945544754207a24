"""Everything a worker writes, read as it comes and kept up to a bound."""

import os
import selectors
import subprocess
import time
from typing import Any, cast

from grs_agents.sandbox import wire
from grs_agents.sandbox.call import CallOutcome

_KEPT_OUTPUT = 64 << 10

Ending = tuple[CallOutcome, dict[str, Any] | None, str]
"""Outcome, value and error of a call, as far as the pipes tell."""


class Streams:
    """The pipes from a worker.

    Args:
        process: the worker.
        result: the pipe that its frames come through; closed with the rest.
        trace: the pipe that ``faulthandler`` writes to; closed with the rest.
    """

    def __init__(self, process: "subprocess.Popen[bytes]", result: int, trace: int) -> None:
        assert process.stdout is not None
        self.events: list[dict[str, Any]] = []
        self._reader = wire.FrameReader()
        self._stdout = process.stdout
        self._kept = {"output": bytearray(), "trace": bytearray()}
        self._total = 0
        self._names = {"result": result, "trace": trace, "output": process.stdout.fileno()}
        self._selector = selectors.DefaultSelector()
        if hasattr(os, "pidfd_open"):  # a dead worker is noticed even if a process it forked holds its pipes
            self._names["exit"] = os.pidfd_open(process.pid)
        for name, descriptor in self._names.items():
            if name != "exit":
                os.set_blocking(descriptor, False)
            self._selector.register(descriptor, selectors.EVENT_READ, name)

    def keyed(self, request: dict[str, Any]) -> dict[str, Any]:
        """``request`` with the ``key`` that every frame from now on must be sealed with; send it at once."""
        key = wire.new_key()
        self._reader.require(bytes.fromhex(key))
        return {**request, "key": key}

    def listen(self, deadline: float, most: int, until_ready: bool = False) -> Ending | None:
        """Read until the answer, the deadline (monotonic) or ``most`` bytes; None if the worker ended by itself."""
        while (left := deadline - time.monotonic()) > 0:
            ready = {cast(str, key.data) for key, _ in self._selector.select(left)}
            for name in ("output", "trace", "result", "exit"):  # the answer last: what was printed is kept
                if name not in ready:
                    continue
                ending = self._take(name, until_ready)
                if ending is not None or (name == "exit" or (name == "result" and not self._open("result"))):
                    return ending
            if self._total > most:
                return "output_limit", None, ""
        return "timeout", None, ""

    def _take(self, name: str, until_ready: bool) -> Ending | None:
        data = self._read("result" if name == "exit" else name)
        if name in self._kept:
            self._kept[name] = (self._kept[name] + data)[-_KEPT_OUTPUT:]
            return None
        try:
            for frame in self._reader.frames(data):
                ending = self._interpret(frame, until_ready)
                if ending is not None:
                    self._take("output", False)
                    return ending
        except wire.ForgedFrameError as error:
            return "forged", None, f"something other than the harness wrote to its pipe: {error}"
        except wire.FrameError as error:
            return "error", None, f"the worker sent a malformed frame: {error}"
        return None

    def _interpret(self, frame: dict[str, Any], until_ready: bool) -> Ending | None:
        kind, value = frame.get("kind"), frame.get("value", frame.get("event"))
        if kind == "ready" and until_ready:
            return "ok", None, ""
        if kind == "event" and isinstance(value, dict):
            self.events.append(cast(dict[str, Any], value))
            self._take("output", False)
            self._kept["output"].clear()
            return None
        if kind == "result" and isinstance(value, dict):
            return "ok", cast(dict[str, Any], value), ""
        if kind == "error" and frame.get("outcome") in ("error", "memory_limit"):
            return cast(CallOutcome, frame["outcome"]), None, str(frame.get("error", ""))
        return "error", None, f"the worker sent an unknown frame: {str(frame)[:200]}"

    def _read(self, name: str) -> bytes:
        if not self._open(name):
            return b""
        try:
            data = os.read(self._names[name], 1 << 20)
        except BlockingIOError:
            return b""
        self._total += len(data)
        if not data:
            self._selector.unregister(self._names[name])
        return data

    def _open(self, name: str) -> bool:
        return self._names[name] in self._selector.get_map()

    def text(self, name: str) -> str:
        """What was written to ``output`` or ``trace``."""
        return self._kept[name].decode("utf-8", "replace")

    def close(self) -> None:
        for name in ("output", "trace"):
            self._take(name, False)
        self._selector.close()
        self._stdout.close()
        for name, descriptor in self._names.items():
            if name != "output":
                os.close(descriptor)
