"""``grs doctor``: diagnosis of the installation, with remedies."""

import os
import subprocess
import sys
from dataclasses import asdict, dataclass
from importlib.metadata import PackageNotFoundError, entry_points, metadata, requires, version
from importlib.util import find_spec
from typing import Literal

from packaging.requirements import Requirement
from rich.table import Table
from rich.text import Text

from grs_agents.base import terminal
from grs_agents.base.config.load import UNSAFE
from grs_agents.base.config.schema import Config, Limits
from grs_agents.base.errors import ConfigError
from grs_agents.base.plugins import load_named_class
from grs_agents.base.terminal import print_json
from grs_agents.library.library import Library
from grs_agents.models.factory import ENTRY_POINTS as MODEL_ENTRY_POINTS
from grs_agents.models.factory import PROVIDERS, is_provider_installed
from grs_agents.runs.record import installed_versions
from grs_agents.runs.sandbox_setup import open_sandbox
from grs_agents.sandbox.host.zygote_process import SandboxError
from grs_agents.sandbox.isolation.backends import BACKEND_REMEDIES, BackendChoice, backend_candidates
from grs_agents.toolkit import ToolContext, load_tool
from grs_agents.views.terminal import show_activity_status

_DISTRIBUTION = "grs-agents"
_STYLES = {"works": "green", "absent": "", "not installed": "", "no key": "yellow", "broken": "red"}
GL_BACKENDS = {"egl": "libegl1", "osmesa": "libosmesa6"}


@dataclass(frozen=True)
class Diagnosis:
    """The state of a part of the installation."""

    subject: str
    # `works`; `absent`, `not installed` or `no key` (all optional); `broken` (needed)
    state: Literal["works", "absent", "not installed", "no key", "broken"]
    detail: str
    remedy: str = ""


def diagnose_installation(as_json: bool) -> int:
    """Check sandbox, GL, models and versions. Returns: exit status, 0 if all required parts work, else 3."""
    with show_activity_status("attacking the sandboxes") as show:
        diagnoses = _diagnose_sandboxes()
        show("drawing with OpenGL")
        diagnoses += [_diagnose_gl_backend(name) for name in GL_BACKENDS]
        show("looking at models and packages")
        diagnoses.append(Diagnosis("models offline", "works", "embedded, no key"))
        diagnoses += [*_diagnose_model_providers(), *_diagnose_model_entry_points(), *_diagnose_extras()]
    diagnoses += [Diagnosis(name, "works", value) for name, value in installed_versions().items()]
    if as_json:
        print_json([asdict(diagnosis) for diagnosis in diagnoses])
    else:
        console = terminal.make_console()
        table = Table(box=None, pad_edge=False, header_style="bold")
        table.add_column("what", no_wrap=True)
        table.add_column("state", no_wrap=True)
        table.add_column("found", overflow="fold")
        remedies: dict[str, list[str]] = {}
        for diagnosis in diagnoses:
            style = _STYLES[diagnosis.state]
            table.add_row(Text(diagnosis.subject), Text(diagnosis.state, style=style), Text(diagnosis.detail))
            if diagnosis.remedy:
                remedies.setdefault(diagnosis.remedy, []).append(diagnosis.subject)
        console.print(table)
        if remedies:
            console.print(Text("\nhow to get the rest", style="bold"))
        for remedy, subjects in remedies.items():
            console.print(Text(f"{', '.join(subjects)}\n    {remedy}"))
    return 3 if any(diagnosis.state == "broken" for diagnosis in diagnoses) else 0


def _diagnose_sandboxes() -> list[Diagnosis]:
    """The choice of ``sandbox = "auto"``, then each backend of this system, probed with an endless program."""
    backends = backend_candidates("auto")
    diagnoses = [_diagnose_sandbox_backend(backend) for backend in backends]
    best = next((diagnosis for diagnosis in diagnoses if diagnosis.state == "works"), None)
    if best is not None:
        return [Diagnosis("sandbox", "works", f"auto takes {best.detail.split(':')[0]}"), *diagnoses]
    remedy = f"{' or '.join(BACKEND_REMEDIES[backend] for backend in backends)}, or accept the risk with {UNSAFE}"
    broken = Diagnosis("sandbox", "broken", "nothing separates generated code from this machine", remedy)
    return [broken, *diagnoses]


def _diagnose_sandbox_backend(backend: BackendChoice) -> Diagnosis:
    limits = Limits(wall_seconds=10, cpu_seconds=1)
    tool = load_tool("run_tests")
    try:
        with open_sandbox(Config(sandbox=backend)) as sandbox:
            context = ToolContext(sandbox=sandbox, library=Library(), limits=limits)
            report = tool.run(tool.Request(simulation="while True:\n    pass\n", tests=_TESTS), context).report
    except SandboxError as error:
        return Diagnosis(f"sandbox {backend}", "absent", error.message, BACKEND_REMEDIES[backend])
    detail = f"{report.backend}: it held; an endless program ended as {report.outcome!r} after {report.seconds:.1f} s"
    return Diagnosis(f"sandbox {backend}", "works" if report.outcome == "timeout" else "broken", detail)


_TESTS = "import unittest\nclass T(unittest.TestCase):\n    def test_a(self):\n        import task_code\n"


def _diagnose_gl_backend(name: str) -> Diagnosis:
    """Create a renderer in a separate process: a wrong ``MUJOCO_GL`` breaks the import of mujoco itself."""
    probe = "import mujoco; mujoco.Renderer(mujoco.MjModel.from_xml_string('<mujoco/>'), 8, 8)"
    done = subprocess.run(
        [sys.executable, "-c", probe], env={**os.environ, "MUJOCO_GL": name}, capture_output=True, check=False
    )
    if done.returncode == 0:
        return Diagnosis(f"GL {name}", "works", "renders (optional: GRS itself never needs GL)")
    return Diagnosis(
        f"GL {name}", "absent", "optional: pictures are ray-cast without it", f"apt install {GL_BACKENDS[name]}"
    )


def _diagnose_model_providers() -> list[Diagnosis]:
    """The first provider of each package of an extra; all model classes of each installed package."""
    listed: dict[tuple[str, str], str] = {}
    for name, provider in PROVIDERS.items():
        package = provider.module.partition(".")[0]
        installed = find_spec(package) is not None
        if installed or provider.extra:
            listed.setdefault((package, provider.model_class if installed else ""), name)
    return [_diagnose_model_provider(name) for name in listed.values()]


def _diagnose_model_provider(name: str) -> Diagnosis:
    provider = PROVIDERS[name]
    key = provider.key_variable
    key_state = (f", {key} is set" if os.environ.get(key) else f", {key} is not set") if key else ", needs no key"
    if key and not provider.key_argument:
        key_state += f"; a profile in {name}'s own files will do, too"
    if not is_provider_installed(name):
        missing = f"the package {provider.module} is missing{key_state}"
        return Diagnosis(f"models {name}", "not installed", missing, provider.install_command)
    if provider.key_argument and not os.environ.get(key):
        return Diagnosis(f"models {name}", "no key", f"the package is installed{key_state}", f"export {key}=...")
    return Diagnosis(f"models {name}", "works", f"the package is installed{key_state}")


def _diagnose_model_entry_points() -> list[Diagnosis]:
    """The models offered by other packages, imported."""
    diagnoses: list[Diagnosis] = []
    for entry in entry_points(group=MODEL_ENTRY_POINTS):
        subject = f"models {entry.name}"
        try:
            load_named_class("model", entry.name, MODEL_ENTRY_POINTS, ())
            diagnoses.append(Diagnosis(subject, "works", entry.value))
        except ConfigError as error:
            diagnoses.append(Diagnosis(subject, "absent", error.message, "mend or remove the package that offers it"))
    return diagnoses


def _diagnose_extras() -> list[Diagnosis]:
    """Each extra, whose packages must be installed in a required version."""
    diagnoses: list[Diagnosis] = []
    requirements = [Requirement(text) for text in requires(_DISTRIBUTION) or ()]
    for extra in metadata(_DISTRIBUTION).get_all("Provides-Extra") or []:
        needs = [
            need
            for need in requirements
            if (marker := need.marker) and marker.evaluate({"extra": extra}) and not marker.evaluate({"extra": ""})
        ]
        missing = [need for need in needs if not need.specifier.contains(_get_version(need.name))]
        if missing:
            detail = f"missing: {', '.join(f'{need.name}{need.specifier}' for need in missing)}"
            install = f'pip install "{_DISTRIBUTION}[{extra}]"'
            diagnoses.append(Diagnosis(f"extra {extra}", "not installed", detail, install))
        else:
            versions = ", ".join(f"{need.name} {_get_version(need.name)}" for need in needs)
            diagnoses.append(Diagnosis(f"extra {extra}", "works", versions))
    return diagnoses


def _get_version(package: str) -> str:
    """The installed version; without the package, a version that satisfies no requirement."""
    try:
        return version(package)
    except PackageNotFoundError:
        return "0.dev0"
