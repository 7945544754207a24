"""Single-use workers, as far as a stand-in for ``sandbox-exec`` can show, and what each backend needs."""

import os
import subprocess
import sys
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import get_args

import pytest

import grs_agents
from grs_agents.base.config.schema import Config, Limits
from grs_agents.sandbox.host.sandbox import Sandbox
from grs_agents.sandbox.host.zygote_process import SandboxError
from grs_agents.sandbox.isolation import hardening
from grs_agents.sandbox.isolation.backends import BackendChoice
from grs_agents.sandbox.protocol.report import TestReport
from tests.sandbox.processes import ends
from tests.sandbox.snippets import (
    HOST,
    Execute,
    check_environment,
    check_outcome,
    check_replacement,
    check_stacks,
    start_host,
)

SHOWN = (
    "masked signals",
    "stopped",
    "thread storm",
    "many files",
    "memory",
    "descriptor flood",
    "segfault",
    "close all pipes",
)
SANDBOX_EXEC = '#!/bin/sh\n[ "$1" = -p ] || exit 64\nshift 2\nexec "$@"\n'


@pytest.fixture(scope="module")
def _stand_in(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    program = tmp_path_factory.mktemp("bin") / "sandbox-exec"
    program.write_text(SANDBOX_EXEC)
    program.chmod(0o755)
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("PATH", str(program.parent), prepend=os.pathsep)
        yield


@pytest.fixture(scope="module")
def sandbox(_stand_in: None) -> Iterator[Sandbox]:
    with Sandbox(backend="sandbox-exec", workers=2) as shared:
        yield shared


@pytest.mark.parametrize("name", SHOWN)
def test_attack_is_an_outcome(name: str, execute: Execute) -> None:
    check_outcome(name, execute)


def test_value_output_and_cost(execute: Execute) -> None:
    result = execute("print('hello'); value = {'x': 1}")
    assert (result.outcome, result.value, result.output) == ("ok", {"x": 1}, "hello\n")
    assert 0 < result.cpu_seconds < 0.2, "the imports are not the call's"
    assert result.backend == "sandbox-exec"
    assert not result.retried


def test_cpu_limit_and_timeout_say_where(execute: Execute) -> None:
    check_stacks(execute)


def test_nothing_of_the_host_is_in_the_environment(execute: Execute, monkeypatch: pytest.MonkeyPatch) -> None:
    check_environment(execute, monkeypatch)


def test_no_call_sees_what_another_left(execute: Execute) -> None:
    execute("import json; open('file', 'w').write('x'); json.dumps = None; import os; os.mkdir('closed', 0)")
    found = execute(
        "import json, os, stat\n"
        "value = {'left': os.listdir(), 'mode': stat.S_IMODE(os.stat('.').st_mode), 'json': json.dumps([])}"
    )
    assert found.value == {"left": [], "mode": 0o700, "json": "[]"}


def test_calls_at_once(execute: Execute) -> None:
    with ThreadPoolExecutor(3) as pool:
        results = list(pool.map(lambda n: execute(f"value = {{'n': {n}}}").value, range(4)))
    assert results == [{"n": n} for n in range(4)]


def test_a_test_program(check: Callable[..., TestReport]) -> None:
    tests = "import unittest\nclass T(unittest.TestCase):\n    def test_a(self): self.assertTrue(True)\n"
    report = check(tests + "    def test_b(self):\n        import os; os._exit(0)\n")
    assert [case.outcome for case in report.cases] == ["passed", "exited"]


def test_what_was_killed_between_calls_is_replaced(execute: Execute, sandbox: Sandbox) -> None:
    check_replacement(execute, sandbox)


def test_nothing_is_left_after_closing(_stand_in: None) -> None:
    with Sandbox(backend="sandbox-exec") as sandbox:
        sandbox.call("execute", {"code": "while True: pass"}, Limits(wall_seconds=0.5))
        assert sandbox._zygote is not None
        pids = descendants(sandbox._zygote._process.pid)
        assert len(pids) >= 2
    assert all(ends(pid) for pid in pids)


@pytest.mark.parametrize("code", ["while True: pass", "import time; time.sleep(1000)"])
def test_everything_dies_with_its_host(code: str, _stand_in: None, tool_folder: Path) -> None:
    program = HOST.replace("Sandbox()", "Sandbox(backend='sandbox-exec')").replace("while True: pass", code)
    host, pid = start_host(program, tool_folder)
    pids = descendants(pid)
    host.kill()
    host.wait()
    assert all(ends(pid) for pid in pids), "the sandbox outlived its host"


def test_single_use_worker_that_cannot_start_is_our_error(_stand_in: None) -> None:
    with (
        Sandbox(preload=("no_such_module",), backend="sandbox-exec") as broken,
        pytest.raises(SandboxError, match="No module named 'no_such_module'"),
    ):
        broken.call("execute", {"code": ""})


def test_refusal_lists_each_reason_and_how_to_get_what_is_missing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("PATH", str(tmp_path))
    monkeypatch.setattr(hardening, "find_missing_layers", lambda: {"landlock": "the kernel was started without it"})
    with Sandbox() as sandbox, pytest.raises(SandboxError) as refusal:
        sandbox.call("execute", {"code": ""})
    for part in (
        "bubblewrap: there is no bwrap on the PATH",
        "landlock: no landlock: the kernel was started without it",
    ):
        assert part in refusal.value.message
    for part in ("apt-get install bubblewrap", "lsm=landlock", "--unsafe-no-sandbox"):
        assert part in refusal.value.remedy


def test_a_backend_that_was_chosen_and_lacks_does_not_say_that_nothing_isolates(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("PATH", str(tmp_path))
    with Sandbox(backend="bubblewrap") as sandbox, pytest.raises(SandboxError) as refusal:
        sandbox.call("execute", {"code": ""})
    assert refusal.value.message.startswith("no sandbox by bubblewrap: there is no bwrap on the PATH")


def test_configuration_offers_every_backend() -> None:
    assert get_args(Config.model_fields["sandbox"].annotation) == get_args(BackendChoice)


ELSEWHERE = """
import multiprocessing, os, socket, subprocess, sys, tempfile
from pydantic import BaseModel
sys.modules["fcntl"] = sys.modules["resource"] = None
del os.pidfd_open, os.O_PATH, socket.SOCK_SEQPACKET
sys.platform = {platform!r}
import grs_agents.sandbox
from grs_agents.sandbox.isolation import backends
print(backends.backend_candidates("auto"), backends.missing_requirements("landlock"))
"""


@pytest.mark.parametrize("platform", ["darwin", "win32"])
def test_the_room_can_be_entered_on_other_systems(platform: str) -> None:
    done = subprocess.run(
        [sys.executable, "-c", ELSEWHERE.format(platform=platform)],
        env={**os.environ, "PYTHONPATH": str(Path(grs_agents.__file__).parent.parent)},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert f"it needs Linux, this is {platform}" in done.stdout


def descendants(pid: int) -> list[int]:
    """The process and all that it started, directly or not, as far as they still have their parents."""
    children = Path(f"/proc/{pid}/task/{pid}/children").read_text().split()
    return [pid, *(found for child in children for found in descendants(int(child)))]
