"""Run a check in a forked child that gives up its freedom first, and see what it got."""

import json
import os
import signal
import sys
import traceback
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import grs_agents
from grs_agents.sandbox.harness.captured_error import CapturedError
from grs_agents.sandbox.isolation import hardening, privileges
from grs_agents.sandbox.isolation.privileges import Allowance

PACKAGE = Path(grs_agents.__file__).parent
PYTHON = (Path(sys.prefix), Path(sys.base_prefix), PACKAGE, *map(Path, ("/usr", "/lib", "/lib64", "/dev/urandom")))
"""What a program needs to read in order to import modules."""

ALLOWANCE = Allowance()
NOBODY = 65534
USERS = ("root", "nobody") if sys.platform == "linux" and os.geteuid() == 0 else ("oneself",)
"""Every check runs as each: root has rights that must go."""


@dataclass(frozen=True)
class Got:
    """What came of a check.

    Attributes:
        value: what it returned, or None.
        error: the name of the exception that left it; empty if none did.
        errno: the exception's number, if it is an ``OSError``.
        text: the traceback.
        signal: what killed the child; 0 if nothing did.
    """

    value: Any = None
    error: str = ""
    errno: int | None = None
    text: str = ""
    signal: int = 0


def become(user: str) -> None:
    """Turn this process into that user's."""
    if user == "nobody":
        os.setgroups([])
        os.setresgid(NOBODY, NOBODY, NOBODY)
        os.setresuid(NOBODY, NOBODY, NOBODY)


def forked(check: Callable[[], object]) -> Got:
    """What ``check`` gets in a child of its own, which ends afterwards whatever happens."""
    reading, writing = os.pipe()
    child = os.fork()
    if child == 0:
        try:
            os.close(reading)
            signal.signal(signal.SIGTERM, signal.SIG_DFL)  # the command line's handler may be in this process
            _report(check, writing)
        finally:
            os._exit(70)
    os.close(writing)
    with os.fdopen(reading, "rb") as pipe:
        data = pipe.read()
    status = os.waitpid(child, 0)[1]
    if os.WIFSIGNALED(status):
        return Got(signal=os.WTERMSIG(status))
    return Got(**json.loads(data))


def hardened(
    check: Callable[[], object],
    user: str = USERS[0],
    readable: Sequence[Path] = PYTHON,
    writable: Sequence[Path] = (),
    allowance: Allowance = ALLOWANCE,
) -> Got:
    """What ``check`` gets in a child with all layers on."""

    def confine_and_check() -> object:
        become(user)
        hardening.harden_process(hardening.create_file_rules(readable, writable), allowance)
        return check()

    return forked(confine_and_check)


def without_new_privileges(confine: Callable[[], object], check: Callable[[], object]) -> Got:
    """What ``check`` gets in a child after one layer alone; new privileges are given up before it."""

    def confine_and_check() -> object:
        privileges.forbid_new_privileges()
        confine()
        return check()

    return forked(confine_and_check)


def _report(check: Callable[[], object], writing: int) -> None:
    signal.signal(signal.SIGALRM, signal.SIG_DFL)
    signal.alarm(60)
    got: dict[str, Any] = {}
    with CapturedError() as caught:
        got = {"value": check()}
    if (error := caught.error) is not None:
        text = "".join(traceback.format_exception(error))
        got = {"error": type(error).__name__, "errno": getattr(error, "errno", None), "text": text}
    os.write(writing, json.dumps(got).encode())
    os._exit(0)
