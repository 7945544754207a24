"""Hostile snippets and what a call makes of them, whatever the backend; and a host that is killed in the middle."""

import os
import signal
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

import grs_agents
from grs_agents.sandbox.host.sandbox import Sandbox
from grs_agents.sandbox.protocol.report import CallResult
from grs_agents.sandbox.protocol.startup import ENVIRONMENT

Execute = Callable[..., CallResult]

OUTCOMES = {
    "infinite loop": ("while True: pass", "timeout"),
    "regex loop": ("import re; re.match(r'(a+)+$', 'a' * 40 + 'b')", "timeout"),
    "stopped": ("import os, signal; os.kill(os.getpid(), signal.SIGSTOP)", "timeout"),
    "masked signals": (
        "import signal\nsignal.pthread_sigmask(signal.SIG_BLOCK, range(1, 64))\nwhile True: pass",
        "timeout",
    ),
    "thread storm": (
        "import threading, time\nthreading.stack_size(32768)\n"
        "for _ in range(200): threading.Thread(target=time.sleep, args=(5,), daemon=True).start()\ntime.sleep(5)",
        ("thread_limit", "error"),
    ),
    "many files": ("for n in range(3000): open(f'f{n}', 'w').close()", "scratch_limit"),
    "files, and gone before anybody looked": ("for n in range(300): open(f'f{n}', 'w').close()", "scratch_limit"),
    "large file": ("open('big', 'wb').write(b'x' * (2 << 20))", "scratch_limit"),
    "memory": ("x = []\nwhile True: x.append(bytearray(1 << 20))", "memory_limit"),
    "descriptor flood": ("import os\nwhile True: os.write(1, b'x' * 10000)", "output_limit"),
    "huge result": ("value = {'x': 'y' * (3 << 20)}", "output_limit"),
    "exit 0": ("import os; os._exit(0)", "crashed"),
    "segfault": ("import ctypes; ctypes.string_at(0)", "crashed"),
    "close all pipes": ("import os, time; os.closerange(0, 128); time.sleep(1000)", "crashed"),
    "stack overflow": ("def f(): f()\nf()", "error"),
    "stack overflow in C": (
        "import sys\nsys.setrecursionlimit(10**9)\nx = []\nfor _ in range(10**5): x = [x]\nrepr(x)",
        "crashed",
    ),
    "KeyboardInterrupt": ("raise KeyboardInterrupt", "error"),
    "exception that cannot be shown": (
        "class E(Exception):\n    def __str__(self): raise SystemExit(1)\nraise E()",
        "error",
    ),
    "NaN": ("value = {'x': float('nan')}", "error"),
    "not an object": ("value = [1]", "error"),
}
"""Code, and the outcome or outcomes that it may have."""


def check_outcome(name: str, execute: Execute) -> None:
    """See that a hostile snippet has its outcome, and no value."""
    code, outcome = OUTCOMES[name]
    result = execute(code, **({"wall_seconds": 0.7} if outcome == "timeout" else {}))
    assert result.outcome in (outcome if isinstance(outcome, tuple) else (outcome,)), result
    assert result.value is None
    assert result.error


def check_stacks(execute: Execute) -> None:
    """See that the limits on time say where the code was."""
    result = execute("while True: pass", cpu_seconds=1)
    assert (result.outcome, "line 1" in result.stack) == ("cpu_limit", True)
    result = execute("def spin():\n    while True: pass\nspin()", wall_seconds=0.7)
    assert (result.outcome, "line 2 in spin" in result.stack) == ("timeout", True)


def check_environment(execute: Execute, monkeypatch: pytest.MonkeyPatch) -> None:
    """See that a worker's environment holds nothing of the host's."""
    monkeypatch.setenv("OPENAI_API_KEY", "secret")
    result = execute("import os; value = dict(os.environ)")
    assert result.value is not None
    assert result.value.keys() == {"HOME", "TMPDIR", *ENVIRONMENT}


def check_replacement(execute: Execute, sandbox: Sandbox) -> None:
    """See that a zygote that was killed between calls is replaced by the next one."""
    execute("")
    assert sandbox._zygote is not None
    os.killpg(sandbox._zygote._process.pid, signal.SIGKILL)
    result = execute("value = {'n': 1}")
    assert result.value == {"n": 1}
    assert result.retried


HOST = """
import sys
from pathlib import Path
from grs_agents.base import content
from grs_agents.base.config import Limits
from grs_agents.sandbox import Sandbox
content.add_overlay_folder(Path(sys.argv[1]))
code = "from grs_agents.sandbox.harness.channel import report_progress\\nreport_progress({'at': 1})\\nwhile True: pass"
with Sandbox() as sandbox:
    sandbox.call("execute", {"code": ""})
    print(sandbox._zygote._process.pid, flush=True)
    sandbox.call("execute", {"code": code}, Limits(wall_seconds=60))
"""
"""A program that prints the number of its zygote and then waits for an endless call."""


def start_host(program: str, tool_folder: Path) -> tuple["subprocess.Popen[str]", int]:
    """Run ``HOST`` or a variant of it; the process and its zygote's number."""
    host = subprocess.Popen(
        [sys.executable, "-c", program, str(tool_folder)],
        env={**os.environ, "PYTHONPATH": str(Path(grs_agents.__file__).parent.parent)},
        stdout=subprocess.PIPE,
        text=True,
    )
    assert host.stdout is not None
    with host.stdout:
        return host, int(host.stdout.readline())
