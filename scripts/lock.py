"""Write the lock files: every package of a resolve of pyproject.toml, a ``name==version`` per line.

Usage: ``python scripts/lock.py``. Resolves the present ranges of pyproject.toml with the index and rewrites
``requirements.lock`` (the package and its development tools) and ``requirements-docs.lock``.
Without hashes, so that the same file serves every platform and Python within the ranges.
"""

import json
import subprocess
import sys
import tempfile
import tomllib
from pathlib import Path

ROOT = Path(__file__).parent.parent
HEADER = "# Made by `make lock` from pyproject.toml; do not edit by hand.\n"


def requirements(*groups: str) -> list[str]:
    """The requirement strings of the package (group ``""``) and of dependency groups."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    wanted: list[str] = []
    for group in groups:
        wanted += project["dependency-groups"][group] if group else project["project"]["dependencies"]
    return wanted


def resolve(wanted: list[str]) -> list[tuple[str, str]]:
    """The (name, version) pairs pip would install into an empty environment."""
    with tempfile.TemporaryDirectory() as folder:
        report = Path(folder) / "report.json"
        options = ["--quiet", "--dry-run", "--ignore-installed", "--report", str(report)]
        subprocess.run([sys.executable, "-m", "pip", "install", *options, *wanted], check=True)
        entries = json.loads(report.read_text(encoding="utf-8"))["install"]
    return sorted((entry["metadata"]["name"].lower(), entry["metadata"]["version"]) for entry in entries)


def write(file: str, pairs: list[tuple[str, str]]) -> None:
    """Write a lock file."""
    lines = [f"{name}=={version}" for name, version in pairs]
    (ROOT / file).write_text(HEADER + "\n".join(lines) + "\n", encoding="utf-8")
    print(f"{file}: {len(lines)} packages")


if __name__ == "__main__":
    write("requirements.lock", resolve(requirements("", "dev")))
    write("requirements-docs.lock", resolve(requirements("docs")))
