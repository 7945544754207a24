"""``grs doctor``: what works here, and how to get what does not."""

import os
import subprocess
import sys
from collections.abc import Sequence
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
    """One thing that was looked at."""

    subject: str
    # `works`; `absent`, `not installed` or `no key` (all optional); `broken` (needed)
    state: Literal["works", "absent", "not installed", "no key", "broken"]
    detail: str  # what was found
    remedy: str = ""  # how to get it


def diagnose_installation(as_json: bool) -> int:
    """Look at the sandbox, GL, the models and the versions; 0 if all that GRS needs works, 3 if not."""
    with show_activity_status("attacking the sandboxes") as show:
        diagnoses = _diagnose_all_sandboxes()
        show("drawing with OpenGL")
        diagnoses += [_diagnose_gl_backend(name) for name in GL_BACKENDS]
        show("looking at models and packages")
        diagnoses.append(Diagnosis("models offline", "works", "embedded, no key"))
        diagnoses += [*map(_diagnose_model_provider, _list_providers_to_diagnose()), *_diagnose_own_models()]
        diagnoses += _diagnose_all_extras()
    diagnoses += [Diagnosis(name, "works", value) for name, value in installed_versions().items()]
    if as_json:
        print_json([asdict(diagnosis) for diagnosis in diagnoses])
    else:
        _print_diagnoses(diagnoses)
    return 3 if any(diagnosis.state == "broken" for diagnosis in diagnoses) else 0


def _print_diagnoses(diagnoses: Sequence[Diagnosis]) -> None:
    """Print what was found as a table, and below it each remedy on a line of its own, to be copied."""
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


def _diagnose_all_sandboxes() -> list[Diagnosis]:
    """What ``sandbox = "auto"`` comes to, then each backend of this system: attacked, and given an endless program."""
    asked = backend_candidates("auto")
    diagnoses = {backend: _diagnose_sandbox_backend(backend) for backend in asked}
    best = next((diagnosis for diagnosis in diagnoses.values() if diagnosis.state == "works"), None)
    if best is not None:
        return [Diagnosis("sandbox", "works", f"auto takes {best.detail.split(':')[0]}"), *diagnoses.values()]
    remedy = f"{' or '.join(BACKEND_REMEDIES[backend] for backend in asked)}, or accept the risk with {UNSAFE}"
    broken = Diagnosis("sandbox", "broken", "nothing separates generated code from this machine", remedy)
    return [broken, *diagnoses.values()]


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


def _list_providers_to_diagnose() -> list[str]:
    """Of each package that an extra installs the first provider; of each package that is here all of its classes."""
    listed: dict[tuple[str, str], str] = {}
    for name, provider in PROVIDERS.items():
        package = provider.module.partition(".")[0]
        here = find_spec(package) is not None
        if here or provider.extra:
            listed.setdefault((package, provider.model_class if here else ""), name)
    return list(listed.values())


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


def _diagnose_own_models() -> list[Diagnosis]:
    """The models that other packages offer, and whether they can be imported."""
    diagnoses: list[Diagnosis] = []
    for entry in entry_points(group=MODEL_ENTRY_POINTS):
        subject = f"models {entry.name}"
        try:
            load_named_class("model", entry.name, MODEL_ENTRY_POINTS, ())
            diagnoses.append(Diagnosis(subject, "works", entry.value))
        except ConfigError as error:
            diagnoses.append(Diagnosis(subject, "absent", error.message, "mend or remove the package that offers it"))
    return diagnoses


def _diagnose_all_extras() -> list[Diagnosis]:
    """Whether the packages of each extra are here, in a version that it takes."""
    declared = metadata(_DISTRIBUTION).get_all("Provides-Extra") or []
    wanted = [Requirement(text) for text in requires(_DISTRIBUTION) or ()]
    return [_diagnose_extra(name, [one for one in wanted if _is_required_by_extra(one, name)]) for name in declared]


def _diagnose_extra(name: str, wanted: list[Requirement]) -> Diagnosis:
    missing = [f"{one.name}{one.specifier}" for one in wanted if not one.specifier.contains(_get_version(one.name))]
    if missing:
        detail = f"missing: {', '.join(missing)}"
        return Diagnosis(f"extra {name}", "not installed", detail, _pip_install_command(name))
    return Diagnosis(f"extra {name}", "works", ", ".join(f"{need.name} {_get_version(need.name)}" for need in wanted))


def _is_required_by_extra(wanted: Requirement, extra: str) -> bool:
    """Whether an extra asks for this package and the package itself does not."""
    marker = wanted.marker
    return marker is not None and marker.evaluate({"extra": extra}) and not marker.evaluate({"extra": ""})


def _get_version(package: str) -> str:
    """The version that is installed; one that nothing takes if there is none."""
    try:
        return version(package)
    except PackageNotFoundError:
        return "0.dev0"


def _pip_install_command(extra: str) -> str:
    return f'pip install "{_DISTRIBUTION}[{extra}]"'
