"""What is shipped: wheel and sdist hold the content, the lock fits the ranges."""

import re
import subprocess
import sys
import tarfile
import tomllib
import zipfile
from pathlib import Path
from typing import Any

import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

from grs_agents.base import content
from grs_agents.runs.experiments import CHECKOUT_ONLY

ROOT = Path(__file__).parent.parent
CONTENT = ("graphs", "tools", "prompts", "assets", "evals")
PROJECT: dict[str, Any] = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))


@pytest.fixture(scope="module")
def distributions(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the wheel and the sdist of this source tree."""
    folder = tmp_path_factory.mktemp("dist")
    command = [sys.executable, "-m", "hatchling", "build", "--directory", str(folder)]
    subprocess.run(command, cwd=ROOT, check=True, capture_output=True)
    return folder


@pytest.fixture(scope="module")
def wheel(distributions: Path) -> set[str]:
    """The file names in the wheel."""
    with zipfile.ZipFile(next(distributions.glob("*.whl"))) as archive:
        return set(archive.namelist())


@pytest.fixture(scope="module")
def sdist(distributions: Path) -> set[str]:
    """The file names in the sdist, without its top folder."""
    with tarfile.open(next(distributions.glob("*.tar.gz"))) as archive:
        return {name.partition("/")[2] for name in archive.getnames()}


def shipped() -> set[str]:
    """Every content file of the source tree, relative to its root."""
    return {
        file.relative_to(ROOT).as_posix()
        for folder in CONTENT
        for file in (ROOT / folder).rglob("*")
        if file.is_file() and "__pycache__" not in file.parts and not file.name.startswith(".")
    }


def checkout_only(name: str) -> bool:
    """Whether a content file is for a checkout alone: what measures GRS itself, and what several experiments share."""
    folder, *rest = Path(name).parts
    return folder == "evals" and (len(rest) > 1 or Path(name).stem in ("__init__", *CHECKOUT_ONLY))


def test_the_wheel_bundles_the_content_that_needs_no_checkout(wheel: set[str]) -> None:
    bundled = {name.removeprefix("grs_agents/_bundled/") for name in wheel if name.startswith("grs_agents/_bundled/")}
    assert bundled == {name for name in shipped() if not checkout_only(name)}


def test_bundled_experiments_need_nothing_that_is_left_out() -> None:
    needed = {
        name
        for name in content.content_names("evals")
        if re.search(
            r"^\s*(from|import) evals\b", content.content_path("evals", name).read_text(encoding="utf-8"), re.M
        )
    }
    assert needed == set(CHECKOUT_ONLY)


def test_the_wheel_puts_one_name_into_site_packages(wheel: set[str]) -> None:
    tops = {name.split("/")[0] for name in wheel}
    assert {top for top in tops if not top.endswith(".dist-info")} == {"grs_agents"}
    assert {"grs_agents/py.typed", "grs_agents/examples/behaviour_cloning.py"} <= wheel


def test_the_wheel_carries_licence_and_entry_point(wheel: set[str]) -> None:
    assert any(name.endswith("licenses/LICENSE") for name in wheel)
    assert PROJECT["project"]["scripts"] == {"grs": "grs_agents.cli.entry:main"}


def test_the_sdist_can_be_built_and_tested_from(sdist: set[str]) -> None:
    assert shipped() <= sdist
    assert {"pyproject.toml", "LICENSE", "README.md", "langgraph.json", "tests/test_packaging.py"} <= sdist


def test_neither_holds_what_a_run_or_a_tool_left_behind(wheel: set[str], sdist: set[str]) -> None:
    for name in wheel | sdist:
        assert not {"__pycache__", ".venv", ".git"} & set(name.split("/")), name
        assert not name.startswith("runs/") and "/runs/20" not in name, name


def locked(file: str) -> dict[str, str]:
    """Name to version of a lock file; a line of any other form fails."""
    pinned: dict[str, str] = {}
    for line in (ROOT / file).read_text(encoding="utf-8").splitlines():
        if not line.startswith("#"):
            match = re.fullmatch(r"([A-Za-z0-9._-]+)==([^\s;]+)( ; .+)?", line)
            assert match, f"{file}: {line!r} is not name==version"
            pinned[canonicalize_name(match[1])] = match[2]
    return pinned


@pytest.mark.parametrize(
    ("file", "requirements"),
    [
        ("requirements.lock", PROJECT["project"]["dependencies"] + PROJECT["dependency-groups"]["dev"]),
        ("requirements-docs.lock", PROJECT["dependency-groups"]["docs"]),
    ],
)
def test_the_lock_pins_every_requirement_within_its_range(file: str, requirements: list[str]) -> None:
    pinned = locked(file)
    for requirement in map(Requirement, requirements):
        version = pinned.get(canonicalize_name(requirement.name))
        assert version is not None, f"{requirement.name} is not in {file}: run make lock"
        assert requirement.specifier.contains(version), f"{file} has {requirement.name} {version}: run make lock"


def test_every_range_is_bounded() -> None:
    groups = [PROJECT["project"]["dependencies"], *PROJECT["project"]["optional-dependencies"].values()]
    groups += PROJECT["dependency-groups"].values()
    for requirement in (Requirement(text) for group in groups for text in group):
        operators = {specifier.operator for specifier in requirement.specifier}
        exact = requirement.name == "viser"  # the guard of the page replaces a call inside it
        assert operators >= ({"=="} if exact else {">=", "<"}), f"{requirement} has no lower or no upper bound"


def test_the_ci_script_is_executable_and_parses() -> None:
    script = ROOT / ".ci" / "run"
    assert script.stat().st_mode & 0o111
    subprocess.run(["bash", "-n", str(script)], check=True)
