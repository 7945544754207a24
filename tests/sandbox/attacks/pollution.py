"""What a call might change for the next. Each function does so if told to, and shows how things are.

It runs inside the sandbox, in two calls: one that pollutes, one that only looks.
"""

import atexit
import ctypes
import decimal
import fcntl
import gc
import io
import json
import locale
import os
import random
import resource
import signal
import sys
import threading
import time
import types
import unittest
import warnings
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any, cast

import numpy as np

from grs_agents import sim
from grs_agents.base.mujoco_import import mujoco
from grs_agents.sandbox.harness import channel
from grs_agents.sandbox.protocol import wire
from grs_agents.sim.world import context

libc = ctypes.CDLL(None)


def every_descriptor(action: Callable[[int], Any]) -> None:
    """Do something to each that is open and allows it."""
    for descriptor in range(128):
        with suppress(OSError):
            action(descriptor)


def builtin_functions(pollute: bool) -> Any:
    import builtins

    if pollute:
        builtins.__dict__.update(sorted=lambda _: "polluted", print=None)
    return [sorted([2, 1]), print is None]


def numpy_module(pollute: bool) -> Any:
    if pollute:
        np.__dict__.update(pi=3, array=None)
    return [np.pi, np.array is None]


def numpy_state(pollute: bool) -> Any:
    if pollute:
        np.random.seed(7)
        np.seterr(all="raise")
        np.set_printoptions(precision=1)
    state: Any = np.random.get_state()
    return [np.geterr(), np.get_printoptions()["precision"], state[1][:3].tolist()]


def unittest_module(pollute: bool) -> Any:
    if pollute:
        unittest.TestCase.run = lambda self, result=None: result
        result: Any = unittest.TestResult
        result.addFailure = result.addSuccess
    return [unittest.TestCase.run.__name__, unittest.TestResult.addFailure.__name__]


def mujoco_module(pollute: bool) -> Any:
    if pollute:
        mujoco.__dict__.update(mj_step=None, MjSpec=None)
        mujoco.MjModel.nq = 7
    return [mujoco.mj_step is None, mujoco.MjSpec is None, mujoco.MjModel.from_xml_string("<mujoco/>").nq]


def simulation(pollute: bool) -> Any:
    if pollute:
        sim.set_environment_defaults(seed=99)
        task, environment = cast(Any, sim.Task), cast(Any, sim.Environment)
        task.reset = environment.step = lambda *_: None
    return [context.PROCESS_CONTEXT.seed, sim.Task.reset.__name__, sim.Environment.step.__name__]


def machinery(pollute: bool) -> Any:
    if pollute:
        channel.__dict__.update(send=None, report_progress=None)
        wire.__dict__.update(encode=None)
    return [channel.send is None, channel.report_progress is None, wire.encode is None]


def json_module(pollute: bool) -> Any:
    if pollute:
        json.__dict__.update(dumps=lambda *_, **__: "{}", JSONEncoder=None)
    return json.dumps([1])


def modules(pollute: bool) -> Any:
    if pollute:
        sys.modules["task_code"] = sys.modules["planted"] = types.ModuleType("planted")
        sys.modules.pop("json")
    return ["task_code" in sys.modules, "planted" in sys.modules, "json" in sys.modules]


def import_hooks(pollute: bool) -> Any:
    if pollute:
        sys.meta_path.insert(0, cast(Any, types.SimpleNamespace(find_spec=lambda *_: os._exit(0))))
        sys.path_hooks.clear()
    return [len(sys.meta_path), len(sys.path_hooks)]


def import_path(pollute: bool) -> Any:
    if pollute:
        sys.path.insert(0, str(Path.cwd()))
        sys.path_importer_cache.clear()
    return len(sys.path)


def environment(pollute: bool) -> Any:
    if pollute:
        os.environ["PLANTED"] = "x"
        os.environ.pop("HOME", None)
        libc.setenv(b"LC_ALL", b"xx", 1)
    return sorted(os.environ)


def working_folder(pollute: bool) -> Any:
    if pollute:
        Path("below").mkdir()
        os.chdir("below")
    return Path.cwd().name == "below"


def mask_of_permissions(pollute: bool) -> Any:
    if pollute:
        os.umask(0o777)
    return os.umask(0o77)


def signals(pollute: bool) -> Any:
    numbers = (signal.SIGINT, signal.SIGTERM, signal.SIGUSR1, signal.SIGCHLD)
    if pollute:
        for number in numbers:
            signal.signal(number, lambda *_: None)
        signal.pthread_sigmask(signal.SIG_BLOCK, numbers)
    return [str(signal.getsignal(number)) for number in numbers] + [len(signal.pthread_sigmask(signal.SIG_BLOCK, []))]


def limits(pollute: bool) -> Any:
    names = (resource.RLIMIT_NOFILE, resource.RLIMIT_STACK, resource.RLIMIT_CORE)
    if pollute:
        for name in names:
            resource.setrlimit(name, (16, 16))
    return [resource.getrlimit(name) for name in names]


def priority(pollute: bool) -> Any:
    if pollute:
        os.nice(5)
    return os.getpriority(os.PRIO_PROCESS, 0)


def interpreter(pollute: bool) -> Any:
    if pollute:
        sys.setrecursionlimit(99)
        sys.setswitchinterval(9)
        gc.disable()
        gc.callbacks.append(print)
    return [sys.getrecursionlimit(), sys.getswitchinterval(), gc.isenabled(), len(gc.callbacks)]


def tracing(pollute: bool) -> Any:
    if pollute:
        sys.settrace(lambda *_: None)
        threading.setprofile(lambda *_: None)
    return [str(sys.gettrace()), str(threading.getprofile())]


def threads(pollute: bool) -> Any:
    if pollute:
        for daemon in (True, False):
            threading.Thread(target=threading.Event().wait, daemon=daemon).start()
    return threading.active_count()


def audit_hooks(pollute: bool) -> Any:
    def refuse(event: str, _: object) -> None:
        if event == "open":
            raise RuntimeError("polluted")

    if pollute:
        sys.addaudithook(refuse)
        return None
    return Path("file").write_text("x") and None


def numbers_of_the_interpreter(pollute: bool) -> Any:
    """The small integers are shared by all code; this one is 251 from then on."""
    if pollute:
        ctypes.memset(id(250) + 24, 251, 1)
        return None
    return str(int("250"))


def code_of_the_c_library(pollute: bool) -> Any:
    function = ctypes.cast(libc.abs, ctypes.c_void_p)
    if pollute and libc.mprotect(ctypes.c_void_p((function.value or 0) & ~4095), 8192, 7) == 0:
        ctypes.memset(function, 0xC3, 1)
    return libc.abs(-7)


def standard_output(pollute: bool) -> Any:
    if pollute:
        sys.stdout = sys.stderr = io.StringIO("polluted")
    return [type(sys.stdout).__name__, type(sys.stderr).__name__]


def modes_of_descriptors(pollute: bool) -> Any:
    """They belong to what is open, not to the process: whoever shares it has them too."""
    if pollute:
        every_descriptor(lambda at: fcntl.fcntl(at, fcntl.F_SETFL, os.O_NONBLOCK | os.O_APPEND | os.O_ASYNC))
    found: list[list[int]] = []
    every_descriptor(lambda at: found.append([at, fcntl.fcntl(at, fcntl.F_GETFL)]))
    return found


def positions_of_files(pollute: bool) -> Any:
    if pollute:
        every_descriptor(lambda at: os.lseek(at, 99, os.SEEK_SET))
    found: list[list[int]] = []
    every_descriptor(lambda at: found.append([at, os.lseek(at, 0, os.SEEK_CUR)]))
    return found


def locks_of_files(pollute: bool) -> Any:
    taken: list[int] = []
    every_descriptor(lambda at: (fcntl.flock(at, fcntl.LOCK_EX | fcntl.LOCK_NB), taken.append(at)))
    return None if pollute else taken


def random_numbers(pollute: bool) -> Any:
    """They are others in every process anyway; these would be the same."""
    seeded = random.Random(7).getstate()
    if pollute:
        random.seed(7)
    return random.getstate() == seeded


def settings_of_python(pollute: bool) -> Any:
    if pollute:
        warnings.simplefilter("error")
        decimal.getcontext().prec = 2
        locale.setlocale(locale.LC_ALL, "C")
        os.environ["TZ"] = "XXX9"
        time.tzset()
        atexit.register(os._exit, 7)
    return [len(warnings.filters), decimal.getcontext().prec, locale.getlocale(), time.tzname]
