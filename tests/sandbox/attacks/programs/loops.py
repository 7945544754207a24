"""Code that does not end, or does not mean to be ended."""

import contextlib
import ctypes
import faulthandler
import hashlib
import os
import re
import resource
import signal
import threading

from tests.sandbox.attacks.kit import REFUSED, World, call, gets, libc


def spin() -> None:
    """For ever."""
    while True:
        pass


@gets("timeout", wall_seconds=0.3)
def infinite_loop(world: World) -> None:
    spin()


@gets("timeout", wall_seconds=0.3)
def catastrophic_regex(world: World) -> None:
    re.match(r"(a+)+$", "a" * 40 + "b")


@gets("timeout", wall_seconds=0.3)
def masked_and_ignored_signals(world: World) -> None:
    for number in range(1, 64):
        with contextlib.suppress(OSError, ValueError):
            signal.signal(number, signal.SIG_IGN)
    signal.pthread_sigmask(signal.SIG_BLOCK, range(1, 64))
    spin()


@gets("timeout", wall_seconds=0.3)
def stops_itself(world: World) -> None:
    os.kill(os.getpid(), signal.SIGSTOP)


@gets("timeout", wall_seconds=0.3)
def stops_itself_by_thread(world: World) -> None:
    call("tgkill", os.getpid(), threading.get_native_id(), int(signal.SIGSTOP))


@gets("timeout", wall_seconds=0.3)
def sleeps_in_the_kernel(world: World) -> None:
    os.read(os.pipe()[0], 1)


@gets("timeout", wall_seconds=0.3)
def catches_everything(world: World) -> None:
    faulthandler.cancel_dump_traceback_later()
    faulthandler.disable()
    while True:
        with contextlib.suppress(BaseException):
            spin()


@gets("timeout", wall_seconds=0.3)
def leads_a_session_of_its_own(world: World) -> None:
    with contextlib.suppress(OSError):
        os.setsid()
    with contextlib.suppress(OSError):
        os.setpgid(0, 0)
    spin()


@gets("cpu_limit", cpu_seconds=1)
def ignores_the_processor_limit(world: World) -> None:
    signal.signal(signal.SIGXCPU, signal.SIG_IGN)
    spin()


@gets("cpu_limit", cpu_seconds=1)
def spins_in_threads_without_the_interpreter_lock(world: World) -> None:
    data = bytes(1 << 20)
    for _ in range(2):
        threading.Thread(target=lambda: [hashlib.sha256(data) for _ in iter(int, 1)], daemon=True).start()
    spin()


@gets("nothing")
def raises_its_own_limits(world: World) -> list[str] | None:
    raised = []
    for name in ("RLIMIT_CPU", "RLIMIT_AS", "RLIMIT_FSIZE", "RLIMIT_NOFILE", "RLIMIT_CORE"):
        with contextlib.suppress(OSError, ValueError):
            resource.setrlimit(getattr(resource, name), (resource.RLIM_INFINITY, resource.RLIM_INFINITY))
            raised.append(name)
    return raised or None


@gets("nothing")
def raises_its_limits_by_number(world: World) -> list[int] | None:
    """``prlimit`` on itself, past the ``resource`` module."""
    endless = (ctypes.c_uint64 * 2)(2**64 - 1, 2**64 - 1)
    limits = (resource.RLIMIT_CPU, resource.RLIMIT_AS, resource.RLIMIT_FSIZE, resource.RLIMIT_NOFILE)
    return [number for number in limits if libc.prlimit64(0, number, endless, None) == 0] or None


@gets(*REFUSED)
def favours_itself(world: World) -> int:
    os.setpriority(os.PRIO_PROCESS, 0, -10)
    return os.getpriority(os.PRIO_PROCESS, 0)


@gets(*REFUSED)
def asks_for_real_time(world: World) -> int:
    os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(1))
    return os.sched_getscheduler(0)
