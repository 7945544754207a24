"""The host's door: call a tool in a worker and get a value back, whatever the code in it does."""

import json
import queue
import threading
import weakref
from collections.abc import Generator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

from grs_agents.base import content
from grs_agents.sandbox.host import isolation_probe
from grs_agents.sandbox.host.streams import run_call_in_child
from grs_agents.sandbox.host.zygote_process import DOCTOR, SandboxError, Zygote, ZygoteSpec
from grs_agents.sandbox.isolation import allowlist
from grs_agents.sandbox.isolation.backends import (
    BACKEND_REMEDIES,
    LAYERS,
    Backend,
    BackendChoice,
    backend_candidates,
    missing_requirements,
)
from grs_agents.sandbox.protocol import wire
from grs_agents.sandbox.protocol.report import CallResult, Limits
from grs_agents.sandbox.protocol.scratch_folders import remove_orphaned_folders


class Sandbox:
    """Runs each call in a hardened process forked from a process that has its imports done.

    The modules of ``preload`` and the tool files ``tools`` are imported before the first call, and the functions of
    ``preload`` (``module:function``) called. The backend ``auto`` is the strongest that holds against the probe's
    attacks; ``none`` is no separation at all. At most ``workers`` calls run at once; more wait for their turn.
    ``limits`` is the default of each call, and fixes the size of scratch folders too. Workers may read ``readable``,
    beside their own libraries, and write into the folders ``writable``, whose size nothing bounds.

    Safe to share between threads. Use it as a context manager, or ``close`` it.
    """

    def __init__(
        self,
        preload: Sequence[str] = (),
        *,
        tools: Sequence[str] = (),
        backend: BackendChoice = "auto",
        workers: int = 1,
        limits: Limits | None = None,
        readable: Sequence[Path] = (),
        writable: Sequence[Path] = (),
    ) -> None:
        self._spec = ZygoteSpec(
            tuple(preload),
            tuple(tools),
            limits or Limits(),
            workers,
            tuple(readable),
            tuple(map(Path.resolve, writable)),
        )
        self._choice: BackendChoice = backend
        self._candidates = list(backend_candidates(backend))
        self._failures: dict[Backend, SandboxError] = {}
        self._proven: Backend | None = None
        self._zygote: Zygote | None = None
        self._lock = threading.Lock()
        self._slots: queue.SimpleQueue[int] = queue.SimpleQueue()
        for slot in range(workers):
            self._slots.put(slot)
        remove_orphaned_folders()

    @property
    def backend(self) -> str:
        """The separation of workers from this process, as results record it."""
        return LAYERS[self._proven] if self._proven else self._choice

    @property
    def is_proven(self) -> bool:
        """True if a backend has held against the probe's attacks; no weaker backend follows it."""
        return self._proven is not None

    def warm_up(self, readable: Sequence[Path] = ()) -> None:
        """Begin the imports now, so that the first call finds them done. Calls may read ``readable``, as in ``call``;
        a path that only a later call names has them done again."""
        with self._lock, suppress(SandboxError):  # a missing backend matters to a call, and not every run makes a call
            if self._zygote is None:
                self._add_readable(readable)
                self._zygote = self._launch_zygote()

    def preload(self, function: str, arguments: Sequence[str], readable: Sequence[Path] = ()) -> None:
        """Call ``function`` (``module:function``) once for the calls from now on, with these arguments in place of
        earlier ones; it and they may read ``readable``."""
        entry = f"{function}:{json.dumps(arguments)}"
        with self._lock:
            if entry not in self._spec.preload:
                others = [each for each in self._spec.preload if not each.startswith(f"{function}:")]
                self._spec = replace(self._spec, preload=(*others, entry))
                self._add_readable(readable)
                self._discard_zygote()

    def call(
        self, tool: str, request: dict[str, Any], limits: Limits | None = None, readable: Sequence[Path] = ()
    ) -> CallResult:
        """Run ``inside(request)`` of the tool file ``tool`` in a worker.

        This call and later calls may read ``readable`` (files and folders).

        Raises:
            UnknownNameError: no such tool.
            SandboxError: no worker can be started.
            ValueError: the request is not plain JSON (NaN, infinity).
        """
        content.content_path("tools", tool)
        return self._call({"tool": tool, "module": None}, request, limits, readable)

    def call_module(
        self, module: str, request: dict[str, Any], limits: Limits | None = None, readable: Sequence[Path] = ()
    ) -> CallResult:
        """As ``call``, with the function ``inside`` of the installed module ``module``, a dotted name."""
        return self._call({"tool": None, "module": module}, request, limits, readable)

    def _call(
        self, target: dict[str, Any], request: dict[str, Any], limits: Limits | None, readable: Sequence[Path]
    ) -> CallResult:
        overlays = allowlist.content_overlays()
        frame = {**target, "request": request, "overlays": [str(root) for root in overlays]}
        wire.encode(frame)
        limits = limits or self._spec.limits
        slot = self._slots.get()
        try:
            for retried in (False, True):
                with self._borrow_zygote(slot, (*readable, *allowlist.content_paths(overlays))) as zygote:
                    result = run_call_in_child(zygote, slot, frame, limits)
                    zygote.lost |= result is None
                if result is not None:
                    return result.model_copy(update={"retried": retried})
        finally:
            self._slots.put(slot)
        error = "the process that forks the workers ended twice during this call"
        return CallResult(outcome="crashed", error=error, backend=self.backend, retried=True)

    def close(self) -> None:
        """End every process and delete every file. A later call restarts them."""
        with self._lock:
            self._discard_zygote()

    def __enter__(self) -> "Sandbox":
        return self

    def __exit__(self, *exception: object) -> None:
        self.close()

    @contextmanager
    def _borrow_zygote(self, slot: int, readable: Sequence[Path]) -> Generator[Zygote]:
        """A zygote whose children may read ``readable``; a lost or replaced zygote ends afterwards."""
        with self._lock:
            zygote = self._get_usable_zygote(slot, readable)
            zygote.calls += 1
        try:
            yield zygote
        finally:
            with self._lock:
                zygote.calls -= 1
                if zygote.lost and zygote is self._zygote:
                    self._zygote = None
                if zygote.calls == 0 and zygote is not self._zygote:
                    zygote.close()

    def _get_usable_zygote(self, slot: int, readable: Sequence[Path]) -> Zygote:
        """The running zygote if it is usable, else a new zygote."""
        wanted = self._add_readable(readable)
        if self._zygote is not None and not all(
            allowlist.is_path_covered(path, self._zygote.readable) for path in wanted
        ):
            self._discard_zygote()
        while True:
            zygote = self._zygote = self._zygote or self._launch_zygote()
            try:
                zygote.await_ready()
                if self._proven is None:
                    isolation_probe.verify_attacks_fail(zygote, slot)
            except SandboxError as error:
                self._discard_zygote()
                self._exclude_backend(zygote.backend, error)
                continue
            self._proven = zygote.backend
            return zygote

    def _add_readable(self, paths: Sequence[Path]) -> tuple[Path, ...]:
        """Let zygotes that are launched from now on read ``paths``. Returns: the outermost of them, absolute."""
        outermost = allowlist.outermost_paths(paths)
        self._spec = replace(self._spec, readable=(*self._spec.readable, *outermost))
        return outermost

    def _launch_zygote(self) -> Zygote:
        """Start a zygote with the strongest backend that is left; ``SandboxError`` if none is."""
        for backend in list(self._candidates):
            if reasons := missing_requirements(backend):
                why, remedies = zip(*reasons, strict=True)
                self._exclude_backend(backend, SandboxError("; ".join(why), ", and ".join(dict.fromkeys(remedies))))
                continue
            zygote = Zygote(backend, self._spec)
            weakref.finalize(self, zygote.close)
            return zygote
        raise self._build_no_backend_error()

    def _exclude_backend(self, backend: Backend, error: SandboxError) -> None:
        """Do not try ``backend`` again; if it once held, raise ``error``, since no weaker backend may follow it."""
        if self._proven is not None:
            raise error
        self._failures[backend] = error
        self._candidates.remove(backend)

    def _build_no_backend_error(self) -> SandboxError:
        """The error with the reason against each candidate, and the remedies."""
        reasons = "; ".join(f"{backend}: {error.message}" for backend, error in self._failures.items())
        failures = self._failures.items()
        remedies = [BACKEND_REMEDIES.get(name, "") if e.remedy == DOCTOR else e.remedy for name, e in failures]
        self._candidates = list(backend_candidates(self._choice))  # missing programs may be installed meanwhile
        remedy = ", or ".join([*filter(None, dict.fromkeys(remedies)), "accept the risk with --unsafe-no-sandbox"])
        if self._choice != "auto":  # another backend may well hold
            return SandboxError(f"no sandbox by {reasons}", remedy)
        return SandboxError(f"nothing separates generated code from this machine ({reasons})", remedy)

    def _discard_zygote(self) -> None:
        """Part with the running zygote; it ends with its last call."""
        zygote, self._zygote = self._zygote, None
        if zygote is not None and zygote.calls == 0:
            zygote.close()
