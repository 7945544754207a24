"""System calls by name, and their failures."""

import errno
import os
import sys
from pathlib import Path

import pytest

from grs_agents.sandbox.isolation import kernel
from tests.needs import needs

pytestmark = needs("64-bit linux")


def test_a_call_answers_as_python_does() -> None:
    assert kernel.make_system_call("getpid") == os.getpid()


def test_a_failed_call_is_an_error_of_the_operating_system() -> None:
    with pytest.raises(OSError, match="Bad file descriptor") as failed:
        kernel.make_system_call("close", -1)
    assert failed.value.errno == errno.EBADF


def test_a_failed_property_is_an_error_of_the_operating_system() -> None:
    with pytest.raises(OSError, match="Invalid argument"):
        kernel.prctl(-1)


@pytest.mark.parametrize(("system", "word"), [("darwin", 2**63 - 1), ("linux", 2**31 - 1)])
def test_other_machines_are_not_known(system: str, word: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "platform", system)
    monkeypatch.setattr(sys, "maxsize", word)
    assert kernel.detect_architecture() is None
    with pytest.raises(OSError, match="getpid") as failed:
        kernel.make_system_call("getpid")
    assert failed.value.errno == errno.ENOSYS


@needs("/proc/self")
def test_a_small_file_of_the_kernel_is_read_and_written() -> None:
    with Path("/proc/self/comm").open(encoding="ascii") as comm:
        name = comm.read()
    try:
        kernel.write_kernel_file("/proc/self/comm", b"renamed")
        assert kernel.read_kernel_file("/proc/self/comm") == b"renamed\n"
    finally:
        kernel.write_kernel_file("/proc/self/comm", name.strip().encode())
    with pytest.raises(FileNotFoundError):
        kernel.read_kernel_file("/proc/self/no such file")
