"""Whatever a program writes to the host, the host makes a report of it that every later reader can hold."""

import json
import resource
import sys
from collections.abc import Iterator

import pytest

from grs_agents.base.config.schema import Limits
from grs_agents.base.trace.events import TestsRun
from grs_agents.base.trace.log import EventLog
from grs_agents.graph.evidence import render_evidence
from grs_agents.library.library import Library
from grs_agents.runs.checkpoint import RecordSerializer
from grs_agents.sandbox.host.sandbox import Sandbox
from grs_agents.toolkit import ToolContext, load_tool
from tests.sandbox.hostile import TESTS, hostile

LIMITS = Limits(wall_seconds=10, cpu_seconds=5)
GROWTH_MIB = 200
EACH = 25
"""Programs for each part, so that parts can run side by side."""


@pytest.fixture(scope="module")
def context() -> Iterator[ToolContext]:
    with Sandbox(preload=("grs_agents.sim:prepare_process",), tools=("run_tests", "instantiate")) as sandbox:
        yield ToolContext(sandbox=sandbox, library=Library(), limits=LIMITS)


def peak_mib() -> float:
    """The most memory that this process has held so far."""
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return peak / (1 << 20 if sys.platform == "darwin" else 1 << 10)


def pytest_generate_tests(metafunc: pytest.Metafunc) -> None:
    if "part" in metafunc.fixturenames:
        programs = int(metafunc.config.getoption("hostile_programs") or 0)
        metafunc.parametrize("part", range(max(1, programs // EACH)))


def test_hostile_messages_become_reports(
    part: int, context: ToolContext, tmp_path_factory: pytest.TempPathFactory
) -> None:
    tests, instances = load_tool("run_tests"), load_tool("instantiate")
    before, kinds = peak_mib(), set[str]()
    log_file = tmp_path_factory.mktemp("hostile") / "events.jsonl"
    with EventLog(log_file) as log:
        for seed in range(part * EACH, (part + 1) * EACH):
            program = hostile(seed)
            report = tests.run(tests.Request(simulation=program.source, tests=TESTS), context).report
            kinds.add(report.outcome)
            plain = report.model_dump(mode="json")
            log.append(TestsRun(report=plain))
            checkpoint = RecordSerializer()
            assert checkpoint.loads_typed(checkpoint.dumps_typed(report)).model_dump(mode="json") == plain
            assert len(render_evidence(report)) < 1 << 20
            result = instances.run(instances.Request(simulation=program.source, seeds=(0, 1)), context)
            assert len(result.instances) + len(result.failures) == 2
            json.dumps(result.model_dump(mode="json")).encode()
    assert log_file.read_text("utf-8").count("\n") >= EACH
    assert len(kinds) > 1, "the programs do not differ in what becomes of them"
    assert peak_mib() - before < GROWTH_MIB
