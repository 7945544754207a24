"""Every attack is made on every backend that this machine has; the outside world is looked at after each."""

import os
import sys
import tempfile
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest

from grs_agents.base import content
from grs_agents.base.config.schema import Limits
from grs_agents.sandbox.host.sandbox import Sandbox
from grs_agents.sandbox.isolation.backends import BackendChoice
from grs_agents.sandbox.protocol.report import CallResult
from tests.needs import require
from tests.sandbox.attacks import kit
from tests.sandbox.attacks.world import Canaries
from tests.sandbox.conftest import BACKENDS
from tests.slow import SLOW

collect_ignore_glob = [] if sys.platform == "linux" else ["test_*.py"]
"""They speak to the kernel by numbers that are Linux's alone."""
BOUNDS = Limits(wall_seconds=20, cpu_seconds=10, memory_mib=256, scratch_mib=64, output_mib=1, threads=16)
KIT = "tests.sandbox.attacks.kit"
EVERY = "every case"
"""In place of a case: all, one after the other in one process."""
PROLOGUE = f"""
import sys, types
for name in ("tests", "tests.sandbox", "tests.sandbox.attacks", {KIT!r}, "program"):
    sys.modules[name] = types.ModuleType(name)
for name, source in (({KIT!r}, request["kit"]), ("program", request["program"])):
    exec(compile(source, name + ".py", "exec"), sys.modules[name].__dict__)
kit, program = sys.modules[{KIT!r}], sys.modules["program"]
kit.libc.prctl(15, request["world"]["token"].encode(), 0, 0, 0)
attack = getattr(program, request["attack"])
cases = [request["case"]] if request["case"] != {EVERY!r} else list(attack.cases)
arguments = [[] if case is None else [attack.cases[case]] for case in cases]
loot = {{case: kit.answer(attack.run, request["world"], *more) for case, more in zip(cases, arguments)}}
got = {{case: thing for case, thing in loot.items() if thing != "nothing"}} or "nothing"
value = {{"got": got if len(cases) > 1 else loot[cases[0]]}}
"""


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """With bubblewrap each test of this folder is slow but the first of its kind: of a function, and of a program."""
    kinds: set[tuple[object, object]] = set()
    for item in items:
        call = getattr(item, "callspec", None)
        if call is not None and call.params.get("door") == "bubblewrap":
            kind = (getattr(item, "originalname", None), call.params.get("program"))
            if kind in kinds:
                item.add_marker(SLOW)
            kinds.add(kind)


@dataclass(frozen=True)
class Door:
    """A sandbox, and how many descriptors its host has open between calls."""

    backend: BackendChoice
    sandbox: Sandbox
    descriptors: list[int]

    def execute(self, code: str, request: dict[str, Any] | None = None, **limits: float) -> CallResult:
        """Run a snippet; what it leaves in ``value`` is the result."""
        return self.sandbox.call("execute", {**(request or {}), "code": code}, bounds(**limits))


def bounds(**limits: float) -> Limits:
    """Small limits, and these."""
    return BOUNDS.model_copy(update=limits)


def open_descriptors() -> int:
    """How many there are in this process."""
    return len(list(Path("/proc/self/fd").iterdir()))


@pytest.fixture(scope="package")
def temporary_folder(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """Where the host makes temporary folders meanwhile, so that those it leaves are seen."""
    folder, before = tmp_path_factory.mktemp("temporary"), tempfile.tempdir
    tempfile.tempdir = str(folder)
    yield folder
    tempfile.tempdir = before


@pytest.fixture(scope="package")
def canaries(tmp_path_factory: pytest.TempPathFactory, temporary_folder: Path, tool_folder: Path) -> Iterator[Canaries]:
    """What an attack might touch."""
    folder = tmp_path_factory.mktemp("canaries")
    watched = Canaries(folder, temporary_folder, tool_folder)
    yield watched
    watched.close()


@pytest.fixture(scope="package", params=BACKENDS)
def door(request: pytest.FixtureRequest, canaries: Canaries, tool_folder: Path) -> Iterator[Door]:
    """A sandbox of each backend, started where the canaries are around."""
    with (
        Sandbox(preload=("grs_agents.sim:prepare_process",), backend=request.param, limits=BOUNDS) as sandbox,
        pytest.MonkeyPatch.context() as brief,
    ):
        brief.setattr("grs_agents.sandbox.host.streams.EXPLAIN_SECONDS", 0.2)  # nobody reads where a program was
        ready = Door(request.param, sandbox, [])
        with pytest.MonkeyPatch.context() as patch:  # started now, so that a test sees only what it opened itself
            patch.setattr(content, "_overlays", [tool_folder])
            assert ready.execute("value = {'got': 1}").value == {"got": 1}
        ready.descriptors.append(open_descriptors())
        yield ready


@pytest.fixture
def watched(door: Door, canaries: Canaries) -> Iterator[Canaries]:
    """The canaries, which must be as before when the test ends, and so are when the next one begins."""
    descriptors = max(open_descriptors(), *door.descriptors)  # fewer if the last call ended the sandbox's process
    yield canaries
    assert not canaries.harm()
    assert open_descriptors() <= descriptors


Make = Callable[[ModuleType, str, str | None], str]


@pytest.fixture
def make(door: Door, watched: Canaries) -> Make:
    """Make an attack; what it got, in a word, or of every case what was something."""

    def attack(program: ModuleType, name: str, case: str | None) -> str:
        facts: kit.Attack = getattr(program, name)
        if facts.machine is not None:
            require(facts.machine)
        if facts.promised_by not in (None, door.backend):
            pytest.skip(f"{facts.promised_by} alone promises it")
        sources = {
            "kit": Path(str(kit.__file__)).read_text("utf-8"),
            "program": Path(str(program.__file__)).read_text("utf-8"),
        }
        bounded = door.backend == "bubblewrap" or os.geteuid() == 0  # who may take capabilities from its programs
        asked = {**sources, "attack": name, "case": case, "world": {**watched.world, "bounded": bounded}}
        result = door.execute(PROLOGUE, asked, **facts.limits)
        assert not result.retried, "it ended the process that forks the workers"
        assert watched.secret not in repr(result), "it read a secret"
        return in_a_word(result)

    return attack


def in_a_word(result: CallResult) -> str:
    """What came of a call: its loot, or how it ended."""
    if result.outcome == "ok" and result.value is not None:
        return str(result.value["got"])
    signal_name = next((word.rstrip(".,:;)") for word in result.error.split() if word.startswith("SIG")), "")
    return f"{result.outcome} by {signal_name}" if result.outcome == "crashed" and signal_name else result.outcome
