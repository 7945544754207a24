"""Strangers' files are read in a worker: without keys, with bounds on memory and time, able to open nothing else."""

import base64
import binascii
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, cast

from grs_agents.base.config.schema import Limits
from grs_agents.base.errors import InputError
from grs_agents.sandbox.host.sandbox import Sandbox
from grs_agents.sandbox.host.zygote_process import SandboxError

READING = Limits(wall_seconds=60, cpu_seconds=20, memory_mib=480, scratch_mib=1, output_mib=256)
"""The most that reading a scene costs, beside 110 MiB of a worker: 64 million pixels of RGB take 450 MiB and 1 s."""
_LONGEST = 2_000
"""Characters of an error of the worker that are repeated."""


@dataclass(frozen=True)
class WorkerReply:
    """Reply of a worker that has held strangers' bytes: callers check types, sizes and ranges."""

    answer: dict[str, Any]  # plain JSON
    blobs: dict[str, bytes]  # by the names that the worker gave them


class ForeignReader:
    """Calls the function ``inside`` of a module that reads files of strangers.

    The strongest working backend is taken, as for generated code. Without any backend, limits and the empty environment
    alone are left: to refuse every photo there would protect nobody.

    Args:
        module: dotted name of a module whose ``inside`` returns ``answer_or_refuse(...)``. It is imported ahead of the
            calls; its memory does not count.
        readable: the files and folders that the calls may read; links in them that lead out are not followed.
        limits: on the cost of a call.
        writable: folders that the calls may write to.
        workers: calls that may run at once.
    """

    def __init__(
        self,
        module: str,
        readable: Sequence[Path],
        limits: Limits = READING,
        writable: Sequence[Path] = (),
        workers: int = 1,
    ) -> None:
        self._module, self._limits = module, limits
        self._options: dict[str, Any] = {
            "workers": workers,
            "limits": limits,
            "readable": tuple(readable),
            "writable": tuple(writable),
        }
        self._sandbox = Sandbox((module,), **self._options)

    def read(self, request: dict[str, Any], name: str, limits: Limits | None = None) -> WorkerReply:
        """Call ``inside(request)`` in a worker, whatever happens to the worker.

        Args:
            request: plain JSON.
            name: of the source, for errors.
            limits: of this call, in place of the reader's.

        Raises:
            InputError: the worker refused it, in its words; or it broke the worker, or cost more than the limits.
        """
        limits = limits or self._limits
        try:
            result = self._sandbox.call_module(self._module, request, limits)
        except SandboxError as error:
            if self._sandbox.is_proven:  # a worker that was lost is no reason to read on without isolation
                raise InputError(f"{name} cannot be read: {error.message}", error.remedy) from error
            self._sandbox.close()
            self._sandbox = Sandbox((self._module,), backend="none", **self._options)
            result = self._sandbox.call_module(self._module, request, limits)
        match result.value:
            case {"answer": answer} if result.outcome == "ok" and isinstance(answer, dict):
                return WorkerReply(cast(dict[str, Any], answer), _join_blobs(result.events, name))
            case {"refused": str(), "message": str() as message, "remedy": str() as remedy} if result.outcome == "ok":
                raise InputError(message[:_LONGEST], remedy[:_LONGEST])
            case _:
                costs = {
                    "memory_limit": f"it takes more than {limits.memory_mib} MiB of memory",
                    "cpu_limit": f"it takes more than {limits.cpu_seconds:g} s",
                    "timeout": f"it takes more than {limits.wall_seconds:g} s",
                    "output_limit": f"it unpacks to more than {limits.output_mib} MiB",
                    "scratch_limit": f"it unpacks to more than {limits.scratch_mib} MiB",
                }
                last = (result.error.strip().splitlines() or ["it ended without an answer"])[-1][:200]
                reason = costs.get(result.outcome, f"it broke the process that read it ({last})")
                raise InputError(f"{name} cannot be read: {reason}", "give a smaller one, or write it anew")

    def close(self) -> None:
        """End the workers."""
        self._sandbox.close()

    def __enter__(self) -> "ForeignReader":
        return self

    def __exit__(self, *exception: object) -> None:
        self.close()


def _join_blobs(events: Sequence[dict[str, Any]], source: str) -> dict[str, bytes]:
    pieces: dict[str, list[bytes]] = {}
    for event in events:
        match event:
            case {"blob": str() as name, "data": str() as data}:
                try:
                    pieces.setdefault(name, []).append(base64.b64decode(data, validate=True))
                except (binascii.Error, ValueError) as error:
                    raise InputError(f"{source} cannot be read: the worker's answer is torn", "try again") from error
            case _:
                continue
    return {name: b"".join(parts) for name, parts in pieces.items()}
