"""``grs doctor``: what works here, and how to get what does not."""

import json
import os
import subprocess
import sys
from dataclasses import asdict, dataclass
from typing import Literal

from rich.console import Console
from rich.table import Table
from rich.text import Text

from grs_agents.config import UNSAFE, Config
from grs_agents.library import Library
from grs_agents.models import PROVIDERS, installed
from grs_agents.run import versions
from grs_agents.run.isolation import open_sandbox
from grs_agents.sandbox import REMEDIES, Choice, Limits, SandboxError, candidates
from grs_agents.toolkit import ToolContext, load_tool

GL_BACKENDS = {"egl": "libegl1", "osmesa": "libosmesa6"}


@dataclass(frozen=True)
class Diagnosis:
    """One thing that was looked at.

    Attributes:
        subject: what.
        state: ``works``, ``absent`` (optional) or ``broken`` (needed).
        detail: what was found.
        remedy: how to get it.
    """

    subject: str
    state: Literal["works", "absent", "broken"]
    detail: str
    remedy: str = ""


def diagnose(as_json: bool) -> int:
    """Look at the sandbox, GL, the models and the versions.

    Returns:
        0 if everything that GRS needs works, 3 if not.
    """
    found = [*_sandboxes(), *(_gl(name) for name in GL_BACKENDS), *(_provider(name) for name in PROVIDERS)]
    found.insert(0, Diagnosis("model offline", "works", "embedded, no key"))
    found += [Diagnosis(name, "works", value) for name, value in versions().items()]
    if as_json:
        print(json.dumps([asdict(one) for one in found], indent=2))
    else:
        table = Table("what", "state")
        table.add_column("found", overflow="fold")
        table.add_column("how to get it", overflow="fold")
        for one in found:
            table.add_row(*map(Text, (one.subject, one.state, one.detail, one.remedy)))
        Console().print(table)
    return 3 if any(one.state == "broken" for one in found) else 0


def _sandboxes() -> list[Diagnosis]:
    """What ``sandbox = "auto"`` comes to, then each backend of this system: attacked, and given an endless program."""
    asked = candidates("auto")
    found = {backend: _sandbox(backend) for backend in asked}
    best = next((one for one in found.values() if one.state == "works"), None)
    if best is not None:
        return [Diagnosis("sandbox", "works", f"auto takes {best.detail.split(':')[0]}"), *found.values()]
    remedy = f"{' or '.join(REMEDIES[backend] for backend in asked)}, or accept the risk with {UNSAFE}"
    broken = Diagnosis("sandbox", "broken", "nothing separates generated code from this machine", remedy)
    return [broken, *found.values()]


def _sandbox(backend: Choice) -> Diagnosis:
    limits = Limits(wall_seconds=10, cpu_seconds=1)
    tool = load_tool("run_tests")
    try:
        with open_sandbox(Config(sandbox=backend)) as sandbox:
            context = ToolContext(sandbox=sandbox, library=Library(), limits=limits)
            report = tool.run(tool.Request(simulation="while True:\n    pass\n", tests=_TESTS), context).report
    except SandboxError as error:
        return Diagnosis(f"sandbox {backend}", "absent", error.message, REMEDIES[backend])
    found = f"{report.backend}: it held; an endless program ended as {report.outcome!r} after {report.seconds:.1f} s"
    return Diagnosis(f"sandbox {backend}", "works" if report.outcome == "timeout" else "broken", found)


_TESTS = "import unittest\nclass T(unittest.TestCase):\n    def test_a(self):\n        import task_code\n"


def _gl(name: str) -> Diagnosis:
    """Make a renderer in a process of its own: a wrong ``MUJOCO_GL`` breaks the import of mujoco itself."""
    probe = "import mujoco; mujoco.Renderer(mujoco.MjModel.from_xml_string('<mujoco/>'), 8, 8)"
    done = subprocess.run(
        [sys.executable, "-c", probe], env={**os.environ, "MUJOCO_GL": name}, capture_output=True, check=False
    )
    if done.returncode == 0:
        return Diagnosis(f"GL {name}", "works", "renders (optional: GRS itself never needs GL)")
    return Diagnosis(
        f"GL {name}", "absent", "optional: pictures are ray-cast without it", f"apt install {GL_BACKENDS[name]}"
    )


def _provider(name: str) -> Diagnosis:
    provider = PROVIDERS[name]
    key = provider.key_variable
    if not installed(name):
        remedy = f'pip install "grs-agents[{provider.extra}]"'
        return Diagnosis(f"models {name}", "absent", "extra not installed", remedy)
    if key and not os.environ.get(key):
        return Diagnosis(f"models {name}", "absent", "installed, no key", f"export {key}=...")
    return Diagnosis(f"models {name}", "works", "installed" + (f", {key} is set" if key else ""))
