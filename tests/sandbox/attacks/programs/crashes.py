"""Ends that nobody asked for: each is an outcome of the call, and nothing else."""

import ctypes
import gc
import os
import signal
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np

from grs_agents.base.mujoco_import import mujoco
from tests.sandbox.attacks.kit import World, gets, libc

DEAD = ("crashed by SIGSEGV", "crashed by SIGABRT", "crashed by SIGBUS")
BALL = "<mujoco><worldbody><body><freejoint/><geom size='.1'/></body></worldbody></mujoco>"


@gets(*DEAD)
def null_pointer(world: World) -> None:
    ctypes.string_at(0)


@gets(*DEAD)
def freed_twice(world: World) -> None:
    libc.malloc.restype = ctypes.c_void_p
    libc.free.argtypes = (ctypes.c_void_p,)
    block = libc.malloc(100_000_000)
    libc.free(block)
    libc.free(block + 8)


@gets("crashed by SIGABRT")
def abort(world: World) -> None:
    os.abort()


@gets(
    "crashed",
    "crashed by SIGKILL",
    "crashed by SIGSEGV",
    "crashed by SIGTERM",
    cases={"KILL": signal.SIGKILL, "SEGV": signal.SIGSEGV, "TERM": signal.SIGTERM},
)
def kills_itself(world: World, number: int) -> None:
    os.kill(os.getpid(), number)


@gets("crashed", cases={"zero": 0, "one": 1, "signal's": 137})
def exits(world: World, status: int) -> None:
    os._exit(status)


@gets("SystemExit", "KeyboardInterrupt", "GeneratorExit", cases={"exit": SystemExit, "interrupt": KeyboardInterrupt})
def raises(world: World, error: type[BaseException]) -> None:
    raise error


def deeper() -> None:
    deeper()


@gets("RecursionError")
def stack_of_python(world: World) -> None:
    deeper()


@gets(*DEAD, "RecursionError")
def stack_of_c(world: World) -> None:
    """Every call from C into Python and back takes its share of the eight megabytes."""
    sys.setrecursionlimit(10**9)
    again: list[Callable[[], None]] = []

    def call_again() -> None:
        again[0]()

    again.append(ctypes.CFUNCTYPE(None)(call_again))
    call_again()


@gets(*DEAD)
def mujoco_without_a_model(world: World) -> None:
    folder = Path(mujoco.__file__).parent
    engine = ctypes.CDLL(str(next(path for path in folder.iterdir() if path.name.startswith("libmujoco."))))
    engine.mj_step(None, None)


@gets(*DEAD, "FatalError")
def mujoco_with_indices_out_of_range(world: World) -> None:
    model = mujoco.MjModel.from_xml_string(BALL)
    data = mujoco.MjData(model)
    model.jnt_qposadr[:] = 2**30
    model.body_parentid[:] = 2**30
    model.dof_bodyid[:] = 2**30
    mujoco.mj_step(model, data)


@gets(*DEAD, "FatalError", "memory_limit", "timeout", wall_seconds=2)
def mujoco_with_wrong_sizes(world: World) -> None:
    """The counts at the head of the model: a thousand times as many bodies as there are."""
    model = mujoco.MjModel.from_xml_string(BALL)
    data = mujoco.MjData(model)
    pointer = ctypes.cast(model._address, ctypes.POINTER(ctypes.c_int64))
    for index in range(16):
        pointer[index] = 10**6
    mujoco.mj_step(model, data)


@gets(*DEAD, "FatalError", "memory_limit")
def mujoco_with_overwritten_data(world: World) -> None:
    model = mujoco.MjModel.from_xml_string(BALL)
    data = mujoco.MjData(model)
    ctypes.memset(data._address, 0xFF, 4096)
    mujoco.mj_step(model, data)


@gets("nothing", "FatalError", *DEAD)
def mujoco_with_numbers_that_are_none(world: World) -> None:
    model = mujoco.MjModel.from_xml_string(BALL)
    data = mujoco.MjData(model)
    data.qpos[:] = np.nan
    data.qvel[:] = np.inf
    model.geom_size[:] = -np.inf
    mujoco.mj_step(model, data)


@gets(*DEAD, "memory_limit")
def overwritten_interpreter(world: World) -> None:
    """``None`` itself, then a collection."""
    ctypes.memset(id(None), 0, 16)
    gc.collect()
    libc.abort()


@gets(*DEAD)
def own_handler_of_a_crash(world: World) -> None:
    """A handler that returns would crash again for ever."""
    signal.signal(signal.SIGABRT, lambda *_: None)
    libc.abort()
