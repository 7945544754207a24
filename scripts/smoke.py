"""Build the sdist, from it the wheel, install that into an empty venv and run the main job from an empty folder.

Usage: ``python scripts/smoke.py``. Besides the wheel the venv holds its requirements, linked from the calling
venv, which has them from the index at the versions of requirements.lock. Nothing else of the source tree or of
the calling venv is visible to the installed package.
"""

import json
import os
import shutil
import subprocess
import sys
import tempfile
import venv
import zipfile
from collections.abc import Iterable
from importlib.metadata import Distribution, PathDistribution, distribution
from importlib.util import cache_from_source
from pathlib import Path

from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

ROOT = Path(__file__).parent.parent
FORBIDDEN = ("graphs", "tools", "prompts", "assets", "evals", "tests")
PROBE = 'from grs_agents import content; print(content.content_path("assets", "scenes") / "groceries")'
PACKAGES = "import sysconfig; print(sysconfig.get_path('purelib'))"


def call(*command: str | Path, folder: Path) -> str:
    """Run a command in ``folder`` without the caller's Python settings; its standard output."""
    environment = {
        key: value for key, value in os.environ.items() if not key.startswith(("PYTHON", "VIRTUAL_ENV", "GRS_"))
    }
    done = subprocess.run(
        [str(part) for part in command], cwd=folder, env=environment, capture_output=True, text=True, check=False
    )
    if done.returncode:
        print(done.stdout, done.stderr, sep="\n", file=sys.stderr)
        sys.exit(f"smoke: {' '.join(map(str, command))} ended with status {done.returncode}")
    return done.stdout


def build(out: Path) -> Path:
    """The wheel, built from the unpacked sdist, which thereby proves complete."""
    call(sys.executable, "-m", "build", "--no-isolation", "--outdir", out, ROOT, folder=ROOT)
    assert next(out.glob("*.tar.gz"))
    return next(out.glob("*.whl"))


def find_dependencies(wheel: Path) -> list[Distribution]:
    """The transitive requirements of the wheel, as installed in the calling venv.

    Raises:
        PackageNotFoundError: the calling venv lacks a requirement.
    """
    (info,) = (part for part in zipfile.Path(wheel).iterdir() if part.name.endswith(".dist-info"))
    waiting: list[tuple[Distribution, tuple[str, ...]]] = [(PathDistribution(info), ())]
    seen: set[tuple[str, tuple[str, ...]]] = set()
    dependencies: dict[str, Distribution] = {}
    while waiting:
        owner, extras = waiting.pop()
        for need in map(Requirement, owner.requires or ()):
            if need.marker and not any(need.marker.evaluate({"extra": extra}) for extra in ("", *extras)):
                continue
            key = (canonicalize_name(need.name), tuple(sorted(need.extras)))
            if key not in seen:
                seen.add(key)
                dependencies[key[0]] = distribution(need.name)
                waiting.append((dependencies[key[0]], key[1]))
    return list(dependencies.values())


def link(dependencies: Iterable[Distribution], packages: Path) -> None:
    """Put the files of installed distributions into the site-packages of another venv, their byte code too."""
    for dependency in dependencies:
        for file in dependency.files or ():
            if ".." in file.parts:  # a command
                continue
            source = Path(str(file.locate()))
            cached = Path(cache_from_source(str(source))) if file.suffix == ".py" else source
            for path in {source, cached}:
                target = packages / file.parent / path.relative_to(source.parent)
                if path.exists() and not target.exists():
                    target.parent.mkdir(parents=True, exist_ok=True)
                    link_or_copy(path, target)


def link_or_copy(source: Path, target: Path) -> None:
    """Another name for a file, or, on another disk, a copy."""
    try:
        target.hardlink_to(source)
    except OSError:
        shutil.copy2(source, target)


def try_out(python: Path, folder: Path) -> None:
    """Run the installed ``grs`` on the bundled scene and check its output."""
    folder.mkdir()
    grs = python.with_name("grs")
    scene = Path(call(python, "-I", "-c", PROBE, folder=folder).strip())
    assert scene.is_dir() and not scene.is_relative_to(ROOT), f"{scene} is not the installed scene"
    site_packages = scene.parents[4]
    leaked = [name for name in FORBIDDEN if (site_packages / name).exists()]
    assert not leaked, f"{leaked} landed in {site_packages}"
    call(grs, "--help", folder=folder)
    call(grs, "list", folder=folder)
    run = json.loads(call(grs, "run", scene, "--out", folder / "run", "--json", folder=folder))
    assert run["status"] == "accepted", f"the sample scene ended in {run['status']}: {run.get('reason')}"
    call(python, "-m", "grs_agents.examples.behaviour_cloning", "--help", folder=folder)


def main() -> None:
    """Build, then try the wheel in a fresh venv."""
    with tempfile.TemporaryDirectory(prefix="grs-smoke-") as name:
        folder = Path(name)
        wheel = build(folder / "dist")
        venv.create(folder / "venv")
        python = folder / "venv" / "bin" / "python"
        pip = (sys.executable, "-m", "pip", "--quiet", "--disable-pip-version-check", "--python", python)
        packages = Path(call(python, "-I", "-c", PACKAGES, folder=folder).strip())
        link(find_dependencies(wheel), packages)
        call(*pip, "install", "--no-compile", "--no-deps", "--no-index", wheel, folder=folder)
        call(*pip, "check", folder=folder)  # that the versions fit
        try_out(python, folder / "wheel")
        print(f"smoke: {wheel.name} ({wheel.stat().st_size / 1e6:.1f} MB), built from the sdist, runs")


if __name__ == "__main__":
    main()
