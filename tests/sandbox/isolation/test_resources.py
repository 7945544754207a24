"""Each limit is reached, and what it answers."""

import errno
import mmap
import os
import resource
import signal
import threading
from collections.abc import Callable
from pathlib import Path

from grs_agents.sandbox.isolation import privileges
from grs_agents.sandbox.isolation.privileges import Allowance
from tests.needs import needs
from tests.sandbox.confined import USERS, Got, become, forked

pytestmark = needs("64-bit linux")

SMALL = Allowance(cpu_seconds=0.1, memory_mib=128, file_mib=1, descriptors=400, threads=8)


def limited(check: Callable[[], object], user: str = USERS[-1]) -> Got:
    def limit_and_check() -> object:
        become(user)
        alone = privileges.use_unique_user_id()
        privileges.drop_capabilities()
        binds = privileges.set_resource_limits(SMALL, alone)
        return [binds, check()]

    return forked(limit_and_check)


def test_memory() -> None:
    assert limited(lambda: len(bytearray(64 << 20))).value == [True, 64 << 20]
    assert limited(lambda: len(bytearray(256 << 20))).error == "MemoryError"
    assert limited(lambda: len(mmap.mmap(-1, 256 << 20))).errno == errno.ENOMEM


def test_file_size(tmp_path: Path) -> None:
    large = tmp_path / "large"
    assert limited(lambda: large.write_bytes(bytes(2 << 20)), USERS[0]).errno == errno.EFBIG
    assert large.stat().st_size == 1 << 20


def test_descriptors() -> None:
    assert limited(lambda: [os.dup(0) for _ in range(400)]).errno == errno.EMFILE


def test_processor_time() -> None:
    def spin() -> None:
        while True:
            pass

    assert limited(spin).signal == signal.SIGXCPU


def start_threads() -> int:
    """How many threads start before the kernel refuses."""
    threading.stack_size(64 << 10)
    end = threading.Event()
    threads: list[threading.Thread] = []
    while len(threads) < 5000:
        thread = threading.Thread(target=end.wait)
        try:
            thread.start()
        except RuntimeError:
            break
        threads.append(thread)
    end.set()
    for thread in threads:
        thread.join()
    return len(threads)


@needs("root")
def test_threads_of_root_are_counted() -> None:
    assert limited(start_threads, "root").value == [True, 8]


def test_threads_of_a_user_are_bounded() -> None:
    got = limited(start_threads)
    assert got.value[0] is True
    assert 8 <= got.value[1] < 4000


@needs("root")
def test_root_that_stays_root_has_no_limit_on_threads_and_is_told_so() -> None:
    assert forked(lambda: privileges.set_resource_limits(SMALL, alone=False)).value is False


def test_nothing_is_raised_and_nothing_comes_back() -> None:
    def check() -> list[object]:
        resource.setrlimit(resource.RLIMIT_NOFILE, (200, 300))
        resource.setrlimit(resource.RLIMIT_FSIZE, (1000, 1000))
        stack = resource.getrlimit(resource.RLIMIT_STACK)
        privileges.set_resource_limits(SMALL, alone=False)
        kinds = ("NOFILE", "FSIZE", "CORE", "MEMLOCK", "MSGQUEUE", "SIGPENDING")
        limits = [list(resource.getrlimit(getattr(resource, f"RLIMIT_{kind}"))) for kind in kinds]
        return [limits, resource.getrlimit(resource.RLIMIT_STACK) == stack]

    expected = [[300, 300], [1000, 1000], [0, 0], [0, 0], [0, 0], [256, 256]]
    assert forked(check).value == [expected, True]
