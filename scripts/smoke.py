"""Build the wheel and the sdist, install each into an empty venv and run the main job from an empty folder.

Usage: ``python scripts/smoke.py``. Dependencies are installed from the index at the versions of requirements.lock;
nothing of the source tree or of the calling venv is visible to the installed package.
"""

import json
import os
import subprocess
import sys
import tempfile
import venv
from pathlib import Path

ROOT = Path(__file__).parent.parent
FORBIDDEN = ("graphs", "tools", "prompts", "assets", "evals", "tests")
PROBE = 'from grs_agents import content; print(content.content_path("assets", "scenes") / "groceries")'


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


def build(out: Path) -> tuple[Path, Path]:
    """The wheel and the sdist; the wheel is built from the unpacked sdist, so both hold what is needed."""
    call(sys.executable, "-m", "build", "--no-isolation", "--outdir", out, ROOT, folder=ROOT)
    return next(out.glob("*.whl")), next(out.glob("*.tar.gz"))


def try_out(python: Path, folder: Path) -> None:
    """Run the installed ``grs`` on the bundled scene and look at what it wrote."""
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
    """Build, then try both distributions one after the other in one fresh venv."""
    with tempfile.TemporaryDirectory(prefix="grs-smoke-") as name:
        folder = Path(name)
        wheel, sdist = build(folder / "dist")
        venv.create(folder / "venv")
        python = folder / "venv" / "bin" / "python"
        pip = (sys.executable, "-m", "pip", "--quiet", "--disable-pip-version-check", "--python", python)
        # Uncompiled: of ten thousand modules the runs import a few, and compile those themselves.
        install = (*pip, "install", "--no-compile")
        call(*install, "--constraint", ROOT / "requirements.lock", wheel, folder=folder)
        try_out(python, folder / "wheel")
        print(f"smoke: {wheel.name} ({wheel.stat().st_size / 1e6:.1f} MB) runs")
        call(*pip, "uninstall", "--yes", "grs-agents", folder=folder)
        call(*install, "--no-deps", sdist, folder=folder)
        try_out(python, folder / "sdist")
        print(f"smoke: {sdist.name} ({sdist.stat().st_size / 1e6:.1f} MB) runs")


if __name__ == "__main__":
    main()
