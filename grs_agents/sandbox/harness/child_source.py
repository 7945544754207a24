"""Where the process of a call comes from: forked from one that has its imports done, or started ahead and used once."""

import gc
import os
import socket
import subprocess
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import Protocol

from grs_agents.sandbox.harness import child
from grs_agents.sandbox.protocol import boot, orders
from grs_agents.sandbox.protocol.orders import Order
from grs_agents.sandbox.protocol.settings import Settings


class Children(Protocol):
    """A source of hardened processes; whoever asks for one awaits its end and reaps it."""

    def start(self, order: Order, descriptors: Sequence[int]) -> int:
        """The number of a process that serves ``order`` with its ``descriptors``: frames, trace and output.

        Raises:
            OSError: the system refused the process.
        """
        ...

    def end(self) -> None:
        """End those that still wait for an order."""
        ...


class Forked:
    """Children of this process, which imports here and now what all of them need."""

    def __init__(self, settings: Settings) -> None:
        self._settings = settings
        child.warm(settings)
        self._scratch = [settings.scratch / str(slot) for slot in range(settings.slots)]
        self._rules = [child.rules(settings, folder) for folder in self._scratch]
        gc.collect()
        gc.freeze()  # the children share these pages for as long as no collector touches them

    def start(self, order: Order, descriptors: Sequence[int]) -> int:
        pid = os.fork()
        if pid == 0:
            frames, trace, output = descriptors
            scratch, rules = self._scratch[order.slot], self._rules[order.slot]
            child.serve(frames, trace, output, scratch, order.limits, self._settings, rules)
        return pid

    def end(self) -> None:
        pass


@dataclass(frozen=True)
class _Idle:
    process: "subprocess.Popen[bytes]"
    channel: socket.socket


class Spawned:
    """Processes that were started ahead, each in the system's sandbox; one waits for each slot.

    Raises:
        ChildProcessError: one did not get ready; its standard error says why.
    """

    def __init__(self, settings: Settings) -> None:
        self._settings = settings
        self._idle: list[_Idle | None] = [self._spawn(slot) for slot in range(len(settings.single_use))]
        for idle in self._idle:
            if idle is not None and idle.channel.recv(len(orders.READY)) != orders.READY:
                self.end()
                raise ChildProcessError("a worker did not start")

    def start(self, order: Order, descriptors: Sequence[int]) -> int:
        idle, self._idle[order.slot] = self._idle[order.slot], None
        if idle is None or idle.process.poll() is not None:
            idle = self._spawn(order.slot)
        with suppress(OSError):  # where it has just ended, its frames end too, and tell the host
            orders.send(idle.channel, order, descriptors)
        idle.channel.close()
        idle.process.returncode = 0  # it is reaped by its number from now on
        with suppress(OSError):  # then the next call has to wait for its process
            self._idle[order.slot] = self._spawn(order.slot)
        return idle.process.pid

    def end(self) -> None:
        for idle in self._idle:
            if idle is not None:
                idle.process.kill()
                idle.process.wait()
                idle.channel.close()

    def _spawn(self, slot: int) -> _Idle:
        ours, theirs = socket.socketpair()
        command = boot.command("worker", theirs.fileno(), self._settings)
        try:
            process = subprocess.Popen(
                [*self._settings.single_use[slot], *command], stdin=subprocess.DEVNULL, pass_fds=(theirs.fileno(),)
            )
        except OSError:
            ours.close()
            raise
        finally:
            theirs.close()
        return _Idle(process, ours)
