"""The process that has a hardened child for each call; it never runs generated code itself.

Started by the host's ``zygote_process.Zygote``, to which it is connected by a socket. Each order arrives with four
descriptors: the child's frames, trace and output, and a control socket over which this process reports how the child
ended. When the host closes its end of the control socket, or of the connection, the child is killed. A child is forked
from a process that has its imports done or, if forking is impossible, started ahead and used once.
"""

import gc
import json
import os
import selectors
import signal
import socket
import subprocess
import time
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from grs_agents.sandbox.harness import child_process
from grs_agents.sandbox.isolation import resource_usage
from grs_agents.sandbox.protocol import startup, wire
from grs_agents.sandbox.protocol.report import Limits
from grs_agents.sandbox.protocol.scratch_folders import delete_folder_contents
from grs_agents.sandbox.protocol.startup import EXPLAIN, Settings
from grs_agents.sandbox.protocol.wire import CallOrder


class Forked:
    """Children of this process, which performs their shared imports now."""

    def __init__(self, settings: Settings) -> None:
        self._settings = settings
        child_process.warm_up(settings)
        self._scratch = [settings.scratch / str(slot) for slot in range(settings.slots)]
        self._rules = [child_process.create_worker_file_rules(settings, folder) for folder in self._scratch]
        gc.collect()
        gc.freeze()  # the children share these pages for as long as no collector touches them
        gc.enable()

    def start_child(self, order: CallOrder, descriptors: Sequence[int]) -> int:
        """The number of a new process that serves ``order`` over ``descriptors`` (frames, trace and output).

        The caller awaits its end and reaps it. ``OSError`` if the system refused the process.
        """
        pid = os.fork()
        if pid == 0:
            frames, trace, output = descriptors
            scratch, rules = self._scratch[order.slot], self._rules[order.slot]
            child_process.serve_request(frames, trace, output, scratch, order.limits, self._settings, rules)
        return pid

    def kill_idle_children(self) -> None:
        """Nothing waits for an order here."""


@dataclass(frozen=True)
class _Idle:
    process: "subprocess.Popen[bytes]"
    channel: socket.socket


class Spawned:
    """Processes that were started ahead, each in the system's sandbox, a waiting process for each slot.

    ``ChildProcessError`` if a process did not get ready; its standard error says why.
    """

    def __init__(self, settings: Settings) -> None:
        self._settings = settings
        self._idle: list[_Idle | None] = [self._spawn_idle_child(slot) for slot in range(len(settings.single_use))]
        for idle in self._idle:
            if idle is not None and idle.channel.recv(len(wire.READY)) != wire.READY:
                self.kill_idle_children()
                raise ChildProcessError("a worker did not start")

    def start_child(self, order: CallOrder, descriptors: Sequence[int]) -> int:
        """As ``Forked.start``."""
        idle, self._idle[order.slot] = self._idle[order.slot], None
        if idle is None or idle.process.poll() is not None:
            idle = self._spawn_idle_child(order.slot)
        with suppress(OSError):  # if it has just ended, its frames end too, and the host sees that
            wire.send_order(idle.channel, order, descriptors)
        idle.channel.close()
        idle.process.returncode = 0  # it is reaped by its number from now on
        with suppress(OSError):  # then the next call has to wait for its process
            self._idle[order.slot] = self._spawn_idle_child(order.slot)
        return idle.process.pid

    def kill_idle_children(self) -> None:
        """End those that still wait for an order."""
        for idle in self._idle:
            if idle is not None:
                idle.process.kill()
                idle.process.wait()
                idle.channel.close()

    def _spawn_idle_child(self, slot: int) -> _Idle:
        ours, theirs = socket.socketpair()
        command = startup.build_command_line("child_process", theirs.fileno(), self._settings)
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


WATCH_SECONDS = 0.05
_REST = 3
"""Pause after a check, as a multiple of its duration: a quarter of a processor, and few folders beyond the limit."""


def main() -> None:
    """Get ready, say so, and serve until the host goes away."""
    host, settings = startup.read_startup_arguments()
    try:
        children = Spawned(settings) if settings.single_use else Forked(settings)
    except ChildProcessError:  # its output has the reason
        os._exit(1)
    with suppress(OSError):
        host.send(wire.READY)
        _Zygote(host, settings, children).serve_orders()
    os._exit(0)


@dataclass(eq=False)
class _Running:
    """A running call."""

    pid: int  # the child
    control: socket.socket  # the socket that the host holds the other end of
    scratch: Path  # the child's folder
    limits: Limits  # its bounds
    memory: int  # its initial memory in bytes, if the kernel keeps no limit on it
    stopped: str = ""  # the limit it broke, if this process noticed


class _Zygote:
    def __init__(self, host: socket.socket, settings: Settings, children: "Forked | Spawned") -> None:
        self._host = host
        self._settings = settings
        self._children = children
        self._running: list[_Running] = []
        self._due = 0.0
        self._wakeup, signals = socket.socketpair()
        self._selector = selectors.DefaultSelector()
        for channel in (host, self._wakeup):
            self._selector.register(channel, selectors.EVENT_READ)
        for channel in (self._wakeup, signals):
            channel.setblocking(False)
        signal.set_wakeup_fd(signals.detach(), warn_on_full_buffer=False)
        signal.signal(signal.SIGCHLD, lambda number, frame: None)  # only handled signals are written to the socket

    def serve_orders(self) -> None:
        """Start, watch and reap children until the host's end of the connection closes."""
        try:
            while self._wait_and_serve_events():
                self._kill_children_over_limits()
        finally:
            self._children.kill_idle_children()
            for running in self._running:
                os.kill(running.pid, signal.SIGKILL)
            for running in self._running:
                os.waitpid(running.pid, 0)
                with suppress(OSError):
                    delete_folder_contents(running.scratch)

    def _wait_and_serve_events(self) -> bool:
        """Wait for events and handle them; False after the host is gone."""
        left = max(self._due - time.monotonic(), 0.0) if self._running else None
        for key, _ in self._selector.select(left):
            if key.fileobj is self._host:
                if not self._accept_order():
                    return False
            elif key.fileobj is self._wakeup:
                with suppress(BlockingIOError):
                    self._wakeup.recv(1 << 12)
            elif isinstance(running := key.data, _Running):
                self._explain_or_kill_child(running)
        for running in list(self._running):
            self._reap_ended_child(running)
        return True

    def _accept_order(self) -> bool:
        """Accept an order and start its child; False after the host is gone."""
        received = wire.receive_order(self._host, 4)
        if received is None:
            return False
        order, (frames, trace, output, control) = received
        if not self._running:
            self._due = time.monotonic() + WATCH_SECONDS
        pid = self._children.start_child(order, (frames, trace, output))
        for descriptor in (frames, trace, output):
            os.close(descriptor)
        scratch = self._settings.scratch / str(order.slot)
        running = _Running(
            pid, socket.socket(fileno=control), scratch, order.limits, resource_usage.count_memory_bytes(pid)
        )
        self._running.append(running)
        self._selector.register(running.control, selectors.EVENT_READ, running)
        return True

    def _explain_or_kill_child(self, running: _Running) -> None:
        """The host asks for the child's stack, or for its end, or is gone."""
        with suppress(OSError):
            if running.control.recv(64) == EXPLAIN:
                os.kill(running.pid, signal.SIGXCPU)  # not reaped yet, so the number cannot belong to anybody else
                return
        self._selector.unregister(running.control)
        os.kill(running.pid, signal.SIGKILL)

    def _reap_ended_child(self, running: _Running) -> None:
        """Report the end of a child that has ended to the host, and empty its scratch folder."""
        pid, status, used = os.wait4(running.pid, os.WNOHANG)
        if pid == 0:
            return
        stopped = running.stopped or ("scratch_limit" if self._exceeds_scratch_limit(running) else "")
        self._running.remove(running)
        with suppress(KeyError):
            self._selector.unregister(running.control)
        report = {"status": status, "cpu_seconds": used.ru_utime + used.ru_stime, "stopped": stopped}
        with suppress(OSError):
            running.control.send(json.dumps(report).encode())
        running.control.close()
        delete_folder_contents(running.scratch)  # before the next order, since this process is sequential
        with os.scandir(running.scratch) as left:
            if any(left):
                raise OSError(f"{running.scratch} cannot be emptied, so nothing may work in it again")

    def _kill_children_over_limits(self) -> None:
        """Periodically kill children over their limits; check less often if checks take long."""
        begin = time.monotonic()
        if begin < self._due:
            return
        for running in self._running:
            if not running.stopped:
                if resource_usage.count_threads(running.pid) > running.limits.threads:
                    running.stopped = "thread_limit"
                elif resource_usage.count_memory_bytes(running.pid) - running.memory > running.limits.memory_mib << 20:
                    running.stopped = "memory_limit"
                elif self._exceeds_scratch_limit(running):
                    running.stopped = "scratch_limit"
                if running.stopped:
                    os.kill(running.pid, signal.SIGKILL)
        end = time.monotonic()
        self._due = end + max(WATCH_SECONDS, _REST * (end - begin))

    def _exceeds_scratch_limit(self, running: _Running) -> bool:
        most = running.limits.scratch_mib << 20
        if self._settings.scratch_is_sized:
            return resource_usage.count_file_system_bytes(running.scratch) >= min(most, self._settings.scratch_bytes)
        unlinked = resource_usage.count_unlinked_bytes(running.pid)
        return unlinked + resource_usage.count_scratch_bytes(running.scratch, most) >= most
