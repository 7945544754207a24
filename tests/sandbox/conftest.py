"""A sandbox with two tools of its own: one executes a snippet, one runs tests without any simulation."""

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from grs_agents.base import content
from grs_agents.base.config.schema import Limits
from grs_agents.sandbox.host.sandbox import Sandbox
from grs_agents.sandbox.host.suite_run import TestRun, run_tests
from grs_agents.sandbox.protocol.report import CallResult, TestReport
from tests.needs import needs

EXECUTE = """
def inside(request):
    scope = {"request": request}
    exec(request["code"], scope)
    return scope.get("value", {})
"""
PLAIN_TESTS = """
from grs_agents.sandbox.harness.suite_runner import run_tests_inside as inside
"""
BACKENDS = [pytest.param("bubblewrap", marks=needs("bwrap")), pytest.param("landlock", marks=needs("landlock"))]
SMALL = Limits(wall_seconds=60, cpu_seconds=10, memory_mib=128, scratch_mib=1, output_mib=1, threads=16)


@pytest.fixture(scope="session")
def tool_folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("content")
    (folder / "tools").mkdir()
    (folder / "tools" / "execute.py").write_text(EXECUTE)
    (folder / "tools" / "plain_tests.py").write_text(PLAIN_TESTS)
    return folder


@pytest.fixture(autouse=True)
def _overlay(tool_folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(content, "_overlays", [tool_folder])


@pytest.fixture(scope="session")
def sandbox() -> Iterator[Sandbox]:
    with Sandbox() as shared:
        yield shared


Execute = Callable[..., CallResult]


@pytest.fixture
def execute(sandbox: Sandbox) -> Execute:
    """Run a snippet in a worker; what it leaves in ``value`` is the result."""

    def call(code: str, **limits: float) -> CallResult:
        return sandbox.call("execute", {"code": code}, SMALL.model_copy(update=limits))

    return call


@pytest.fixture
def check(sandbox: Sandbox) -> Callable[..., TestReport]:
    """Run a test program against a simulation program that need not be one."""

    def call(tests: str, simulation: str = "", limits: Limits = SMALL, **fields: Any) -> TestReport:
        programs = TestRun(simulation=simulation, tests=tests, **fields)
        return run_tests(sandbox, "plain_tests", programs, limits)

    return call
