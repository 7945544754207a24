"""What a hostile snippet gets from a call: an outcome, and nothing else."""

import os
import tempfile
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from grs_agents.base.config.schema import Limits
from grs_agents.base.errors import UnknownNameError
from grs_agents.sandbox.host.sandbox import Sandbox
from grs_agents.sandbox.host.zygote_process import SandboxError
from tests.sandbox.processes import ends
from tests.sandbox.snippets import (
    HOST,
    OUTCOMES,
    Execute,
    check_environment,
    check_outcome,
    check_replacement,
    check_stacks,
    start_host,
)


@pytest.mark.parametrize("name", OUTCOMES)
def test_attack_is_an_outcome(name: str, execute: Execute) -> None:
    check_outcome(name, execute)


def test_what_python_is_refused(execute: Execute) -> None:
    result = execute(
        "import os, socket, subprocess\n"
        "def attempt(action):\n"
        "    try: action()\n"
        "    except OSError as error: return type(error).__name__\n"
        "value = {\n"
        "    'fork': attempt(os.fork),\n"
        "    'subprocess': attempt(lambda: subprocess.run(['true'])),\n"
        "    'shell': attempt(lambda: subprocess.run('true', shell=True)),\n"
        "    'network': attempt(lambda: socket.create_connection(('127.0.0.1', 9))),\n"
        "    'descriptors': attempt(lambda: [os.dup(0) for _ in range(500)]),\n"
        "}"
    )
    assert result.value == {
        "fork": "PermissionError",
        "subprocess": "PermissionError",
        "shell": "PermissionError",
        "network": "PermissionError",
        "descriptors": "OSError",
    }


def test_value_output_and_cost(execute: Execute) -> None:
    result = execute("print('hello'); value = {'x': [1, 2.5, None, 'ü']}")
    assert (result.outcome, result.value, result.error) == ("ok", {"x": [1, 2.5, None, "ü"]}, "")
    assert result.output == "hello\n"
    assert result.seconds > 0
    assert result.cpu_seconds > 0
    assert "landlock+seccomp" in result.backend
    assert not result.retried


def test_cpu_limit_and_timeout_say_where(execute: Execute) -> None:
    check_stacks(execute)


def test_nothing_of_the_host_is_in_the_environment(execute: Execute, monkeypatch: pytest.MonkeyPatch) -> None:
    check_environment(execute, monkeypatch)


def test_no_descriptor_of_the_host_is_inherited(execute: Execute, tmp_path: Path) -> None:
    secret = tmp_path / "secret"
    secret.write_text("key")
    with secret.open() as held:
        os.set_inheritable(held.fileno(), True)
        result = execute(
            "import os\nfound = []\n"
            "for fd in range(128):\n"
            "    try: found.append(os.readlink(f'/proc/self/fd/{fd}'))\n"
            "    except OSError: pass\n"
            "value = {'fds': found}"
        )
    assert result.value is not None
    assert not any("secret" in name for name in result.value["fds"])


def test_standard_input_is_empty(execute: Execute) -> None:
    assert execute("import sys; value = {'read': sys.stdin.read()}").value == {"read": ""}


@pytest.mark.parametrize("depth", [2, 900])
def test_scratch_is_private_and_gone_afterwards(depth: int, execute: Execute) -> None:
    result = execute(
        "import os, stat\nhome = os.getcwd()\n"
        "os.symlink('/usr', 'link')\nopen('file', 'w').write('x')\n"
        f"for _ in range({depth}): os.mkdir('directory'); os.chdir('directory')\n"
        "os.chdir(home); os.mkdir('closed', 0)\n"
        "value = {'home': home == os.environ['HOME']}",
        scratch_mib=64,
    )
    # Under Landlock alone a plain user's host cannot look into the closed folder, which then counts as full.
    unseen = result.outcome == "scratch_limit" and "landlock" in result.backend and os.geteuid() != 0
    assert unseen or result.value == {"home": True}
    found = execute("import os, stat; value = {'left': os.listdir(), 'mode': stat.S_IMODE(os.stat('.').st_mode)}")
    assert found.value == {"left": [], "mode": 0o700}
    assert Path("/usr/bin").exists()


FRAMES = {
    "garbage": b"\xff" * 100,
    "huge length": b"\xff\xff\xff\xff{}",
    "unknown kind": b'\x00\x00\x00\x0d{"kind": "x"}',
    "NaN": b'\x00\x00\x00\x26{"kind": "result", "value": {"x":NaN}}',
    "nested": b"\x00\x01\x86\xa0" + b"[" * 100_000,
}


@pytest.mark.parametrize("name", FRAMES)
def test_forged_bytes_are_an_outcome(name: str, execute: Execute) -> None:
    result = execute(f"import os; os.write(3, {FRAMES[name]!r}); os._exit(0)")
    assert result.outcome == "forged"
    assert result.value is None


def test_events_arrive_even_if_the_worker_dies(execute: Execute) -> None:
    result = execute(
        "from grs_agents.sandbox.harness.channel import report_progress\n"
        "report_progress({'at': 1})\nimport os; os._exit(1)"
    )
    assert result.outcome == "crashed"
    assert result.events == ({"at": 1},)


def test_next_call_is_not_polluted(execute: Execute) -> None:
    execute("import json, numpy, builtins; json.dumps = None; numpy.pi = 3; builtins.len = lambda x: 0")
    assert execute("import numpy; value = {'pi': numpy.pi, 'n': len([1])}").value == {
        "pi": pytest.approx(3.14159, abs=1e-4),
        "n": 1,
    }


def test_two_runs_iterate_sets_alike(execute: Execute) -> None:
    code = "value = {'order': list({f'name{i}' for i in range(50)})}"
    assert execute(code).value == execute(code).value


def test_calls_from_several_threads(execute: Execute) -> None:
    with ThreadPoolExecutor(3) as pool:
        results = list(pool.map(lambda n: execute(f"value = {{'n': {n}}}").value, range(3)))
    assert results == [{"n": 0}, {"n": 1}, {"n": 2}]


def test_unknown_tool_lists_the_tools(sandbox: Sandbox) -> None:
    with pytest.raises(UnknownNameError, match="execute"):
        sandbox.call("exekute", {})


def test_request_must_be_plain_json(sandbox: Sandbox) -> None:
    with pytest.raises(ValueError, match="JSON"):
        sandbox.call("execute", {"code": float("nan")})


def test_worker_that_cannot_start_is_our_error() -> None:
    with Sandbox(preload=("no_such_module",)) as broken, pytest.raises(SandboxError, match="no_such_module"):
        broken.call("execute", {"code": ""})


def test_a_preloaded_function_is_called_ahead_with_its_latest_arguments() -> None:
    with Sandbox() as fresh:
        for action in ("error", "always"):
            fresh.preload("warnings:simplefilter", [action])
            code = "import warnings\nvalue = {'actions': [each[0] for each in warnings.filters]}"
            value = fresh.call("execute", {"code": code}).value
            assert value is not None
            assert value["actions"][0] == action and "error" not in value["actions"][1:]


def test_zygote_that_was_killed_between_calls_is_replaced(execute: Execute, sandbox: Sandbox) -> None:
    check_replacement(execute, sandbox)


def test_close_ends_every_process() -> None:
    sandbox = Sandbox()
    sandbox.call("execute", {"code": ""})
    assert sandbox._zygote is not None
    pid = sandbox._zygote._process.pid
    sandbox.close()
    assert ends(pid)
    assert sandbox.call("execute", {"code": "value = {'n': 1}"}).value == {"n": 1}
    sandbox.close()


def test_everything_dies_with_its_host(tool_folder: Path) -> None:
    host, pid = start_host(HOST, tool_folder)
    host.kill()
    host.wait()
    assert ends(pid), "the sandbox outlived its host"


def test_calls_leave_nothing_behind(tool_folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    before = set(Path("/proc/self/fd").iterdir())
    with Sandbox() as sandbox:
        for code in ("open('file', 'w')", "import os; os._exit(1)", "while True: pass", "value = {'x': float('nan')}"):
            sandbox.call("execute", {"code": code}, Limits(wall_seconds=0.5))
    assert set(Path("/proc/self/fd").iterdir()) == before
    assert not list(tmp_path.iterdir())


def test_limits_are_checked() -> None:
    with pytest.raises(ValueError, match="wall_seconds"):
        Limits(wall_seconds=0)


def test_a_tool_of_ones_own_is_imported_before_the_calls(tool_folder: Path) -> None:
    text = "import os\nIMPORTED = os.getpid()\ndef inside(request):\n    return {'early': IMPORTED != os.getpid()}\n"
    (tool_folder / "tools" / "early.py").write_text(text)
    with Sandbox(tools=("early",)) as sandbox:
        assert sandbox.call("early", {}).value == {"early": True}
    with Sandbox() as sandbox:
        assert sandbox.call("early", {}).value == {"early": False}
