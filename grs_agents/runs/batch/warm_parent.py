"""``python -m grs_agents.runs.batch.warm_parent``: imports what a run needs once, then forks for each run.

Imports take half of the CPU time of a run of a known scene. Requests come over the Unix socket on standard input: the
arguments of ``grs`` as JSON, with the descriptors of a socket and of the run's log. Over that socket a run's exit
status is told, and the number of a signal asks for it. This process ends where the other end of its input is closed,
and runs end together with it: otherwise a killed batch would leave runs behind that lock their folders. Linux alone.
"""

import gc
import importlib
import json
import os
import runpy
import select
import signal
import socket
import sys
from contextlib import suppress
from typing import Final

from grs_agents.base.parent_death import die_with_parent
from grs_agents.runs.deferred_imports import defer_unused_imports

_PRELOADED: Final = (
    *("grs_agents.cli.commands", "grs_agents.cli.run", "grs_agents.graph.editing", "grs_agents.graph.perceive"),
    *("grs_agents.models.offline.chat", "langgraph.graph", "PIL.GifImagePlugin"),
)
"""What most runs import; not rerun nor pyarrow, which start threads: a process with threads is not to be forked."""
LONGEST_REQUEST: Final = 1 << 17
"""Bytes."""


def preload() -> None:
    """Import what runs need, on a single thread."""
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    defer_unused_imports()
    for name in _PRELOADED:
        with suppress(ImportError):  # the run that needs it says so
            importlib.import_module(name)
    gc.freeze()  # no run collects what is imported, nor copies its memory for that


def main() -> None:
    """Serve until the driver has gone; each run is the ``grs`` command in a process of its own."""
    preload()
    command = _Server(socket.socket(fileno=0)).serve()
    if command is not None:
        sys.argv[1:] = command
        runpy.run_module("grs_agents", run_name="__main__", alter_sys=True)


class _Server:
    """The loop of the warm parent. Descriptors are bare numbers, so that a run can close them all."""

    def __init__(self, requests: socket.socket) -> None:
        self._requests = requests
        self._ends: dict[int, int] = {}  # descriptors of the processes, ready at their ends
        self._drivers: dict[int, int] = {}  # sockets by process, of those whose driver listens

    def serve(self) -> list[str] | None:
        """Return the command in the process of each run, None here once the driver has gone."""
        while True:
            ready = self._wait()
            for process, driver in list(self._drivers.items()):
                if driver in ready:
                    self._pass_signals_on(process, driver)
            for process, end in list(self._ends.items()):
                if end in ready:
                    self._report(process)
            if self._requests.fileno() in ready:
                data, descriptors, _, _ = socket.recv_fds(self._requests, LONGEST_REQUEST, 2)
                if not data:
                    self._end_runs()
                    return None
                driver, log = descriptors
                if (command := self._fork(json.loads(data), driver, log)) is not None:
                    return command

    def _wait(self) -> set[int]:
        poll = select.poll()
        for descriptor in (self._requests.fileno(), *self._ends.values(), *self._drivers.values()):
            poll.register(descriptor, select.POLLIN)
        return {descriptor for descriptor, _ in poll.poll()}

    def _pass_signals_on(self, process: int, driver: int) -> None:
        try:
            numbers = os.read(driver, 16)
        except OSError:
            numbers = b""
        for number in numbers:
            os.kill(process, number)  # it is not reaped yet: the number is still its own
        if not numbers:  # the driver listens no longer
            os.close(self._drivers.pop(process))

    def _report(self, process: int) -> None:
        """Reap a run that has ended, and tell its exit status."""
        os.close(self._ends.pop(process))
        _, status = os.waitpid(process, 0)
        if (driver := self._drivers.pop(process, None)) is not None:
            with suppress(OSError):  # the driver has gone
                os.write(driver, b"%d" % os.waitstatus_to_exitcode(status))
            os.close(driver)

    def _end_runs(self) -> None:
        """Ask the runs that are left to end, and wait for them: nobody else reaps them."""
        for process in self._ends:
            os.kill(process, signal.SIGTERM)
        for process in list(self._ends):
            self._report(process)

    def _fork(self, command: list[str], driver: int, log: int) -> list[str] | None:
        """Start a run. Returns: in its process the command, else None."""
        parent = os.getpid()
        process = os.fork()
        if process:
            os.close(log)
            self._ends[process], self._drivers[process] = os.pidfd_open(process), driver
            return None
        die_with_parent(parent, signal.SIGTERM)
        os.setpgid(0, 0)  # Ctrl-C reaches the driver alone, which asks each run once
        self._requests.detach()  # its descriptor is 0
        nothing = os.open(os.devnull, os.O_RDWR)
        for source, target in ((nothing, 0), (nothing, 1), (log, 2)):
            os.dup2(source, target)
        for descriptor in (nothing, log, driver, *self._ends.values(), *self._drivers.values()):
            os.close(descriptor)
        return command


if __name__ == "__main__":
    main()
