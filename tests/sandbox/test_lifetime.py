"""What is started ends: with its call, with its sandbox, and with a host that is killed."""

import os
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

import grs_agents
from grs_agents.base.config.schema import Limits
from grs_agents.sandbox.host import streams, zygote_process
from grs_agents.sandbox.host.sandbox import Sandbox
from grs_agents.sandbox.isolation.backends import BackendChoice
from tests.sandbox.conftest import BACKENDS
from tests.sandbox.processes import ends

NAME = "grs-lifetime"
NAMED = f"import ctypes, os, time\nctypes.CDLL(None).prctl(15, b'{NAME}', 0, 0, 0)\n"
"""A call that can be found from outside."""
HOST = """
import sys
from pathlib import Path
from grs_agents.base import content
from grs_agents.sandbox import Sandbox
content.add_overlay_folder(Path(sys.argv[1]))
Sandbox(backend=sys.argv[2]).call("execute", {"code": sys.argv[3]})
"""


@pytest.fixture(params=BACKENDS)
def backend(request: pytest.FixtureRequest) -> BackendChoice:
    return request.param


@pytest.fixture
def temporary(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Where hosts make temporary folders."""
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    return tmp_path


@pytest.fixture
def sandbox(backend: BackendChoice, temporary: Path) -> Iterator[Sandbox]:
    with Sandbox(backend=backend, limits=Limits(wall_seconds=30, memory_mib=128)) as started:
        yield started


def parents() -> dict[int, tuple[int, str]]:
    """The parent and the name of every process."""
    found: dict[int, tuple[int, str]] = {}
    for folder in Path("/proc").iterdir():
        if folder.name.isdigit():
            try:
                head, tail = (folder / "stat").read_text().rsplit(")", 1)
            except OSError:  # it ended meanwhile
                continue
            found[int(folder.name)] = (int(tail.split()[1]), head.split("(", 1)[1])
    return found


def below(root: int) -> list[int]:
    """The processes that descend from one."""
    everyone = parents()
    found = [root]
    for pid in found:
        found.extend(child for child, (parent, _) in everyone.items() if parent == pid)
    return found[1:]


def running_call(root: int, but: int = 0) -> tuple[int, int]:
    """The process of a call below ``root`` that gave itself its name, and the zygote it was forked from."""
    deadline = time.monotonic() + 120  # ten busy processes a core took more than 30
    while time.monotonic() < deadline:
        everyone = parents()
        for pid in below(root):
            if pid != but and everyone.get(pid, (0, ""))[1] == NAME:
                return pid, everyone[pid][0]
    raise AssertionError("no call began")


def test_nothing_outlives_a_host_that_was_killed(backend: BackendChoice, temporary: Path, tool_folder: Path) -> None:
    code = f"{NAMED}open('left by a call', 'w').write('x')\nos.makedirs('a/b')\nwhile True: pass"
    host = subprocess.Popen(
        [sys.executable, "-c", HOST, str(tool_folder), backend, code],
        env={**os.environ, "PYTHONPATH": str(Path(grs_agents.__file__).parent.parent), "TMPDIR": str(temporary)},
    )
    running_call(host.pid)
    family = below(host.pid)
    host.kill()
    host.wait()
    assert all(ends(pid) for pid in family)
    assert not list(temporary.rglob("left by a call"))
    for folder in temporary.iterdir():
        os.utime(folder, (0, 0))  # the next host takes young folders for those of a host that is just starting
    Sandbox(backend=backend).close()
    assert not list(temporary.iterdir())


def test_a_killed_zygote_costs_one_call_a_second_try(sandbox: Sandbox) -> None:
    with ThreadPoolExecutor(1) as pool:
        call = pool.submit(sandbox.call, "execute", {"code": f"{NAMED}time.sleep(0.5); value = {{'n': 1}}"})
        child, zygote = running_call(os.getpid())
        os.kill(zygote, signal.SIGKILL)
        result = call.result()
    assert (result.outcome, result.value, result.retried) == ("ok", {"n": 1}, True)
    assert ends(child)
    assert ends(zygote)
    after = sandbox.call("execute", {"code": "value = {'n': 2}"})
    assert (after.value, after.retried) == ({"n": 2}, False)


def test_a_call_whose_zygote_is_killed_twice_crashes(sandbox: Sandbox) -> None:
    with ThreadPoolExecutor(1) as pool:
        call = pool.submit(sandbox.call, "execute", {"code": f"{NAMED}time.sleep(30)"})
        first = 0
        for _ in range(2):
            first, zygote = running_call(os.getpid(), but=first)
            os.kill(zygote, signal.SIGKILL)
        result = call.result()
    assert (result.outcome, result.value, result.retried) == ("crashed", None, True)
    assert result.error
    assert sandbox.call("execute", {"code": "value = {'n': 2}"}).value == {"n": 2}


def test_a_stopped_zygote_does_not_stop_the_host(sandbox: Sandbox, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(streams, "END_SECONDS", 2.0)
    monkeypatch.setattr(zygote_process, "END_SECONDS", 2.0)
    with ThreadPoolExecutor(1) as pool:
        limits = Limits(wall_seconds=1, memory_mib=128)
        call = pool.submit(sandbox.call, "execute", {"code": f"{NAMED}time.sleep(0.5); value = {{'n': 1}}"}, limits)
        _, zygote = running_call(os.getpid())
        os.kill(zygote, signal.SIGSTOP)
        result = call.result()
    assert result.value in ({"n": 1}, None)
    assert ends(zygote)


MIXED = (
    "value = {'n': 1}",
    "1 / 0",
    "import os; os._exit(0)",
    "import os; os.kill(os.getpid(), 9)",
    "import os; os.makedirs('a/b'); open('a/b/c', 'w')",
    "import threading\nfor _ in range(5): threading.Thread(target=threading.Event().wait).start()",
    "print('x' * 10_000_000)",
    "import os; os.closerange(0, 128)",
)


def test_calls_of_every_kind_leave_nothing_behind(sandbox: Sandbox, temporary: Path) -> None:
    others = set(below(os.getpid()))
    sandbox.call("execute", {"code": ""})
    processes, files = set(below(os.getpid())), sorted(temporary.rglob("*"))
    descriptors = len(list(Path("/proc/self/fd").iterdir()))
    for _ in range(3):
        for code in MIXED:
            sandbox.call("execute", {"code": code})
    assert set(below(os.getpid())) == processes
    assert sorted(temporary.rglob("*")) == files
    assert len(list(Path("/proc/self/fd").iterdir())) == descriptors
    sandbox.close()
    assert not list(temporary.iterdir())
    assert not [pid for pid in processes - others if not ends(pid)]
