"""Standard streams that are full, narrow or closed, and a shell that allows few open files: one line each."""

import os
import resource
import shutil
import subprocess
import sys
from pathlib import Path
from typing import IO

import pytest

from tests.cli.test_foreign_folder import made
from tests.needs import needs
from tests.slow import SLOW

__all__ = ["made"]

VERBS = (
    ("show", "run"),
    pytest.param(("show", "run", "--json"), marks=SLOW),
    pytest.param(("list",), marks=SLOW),
    ("--help",),
    pytest.param(("report", "run", "--out", "-"), marks=SLOW),
)
"""Each in a process of its own."""


@pytest.fixture
def run(made: Path, tmp_path: Path) -> Path:
    """A copy of a run that ends before its audit: a film would be drawn anew in each process."""
    folder = Path(shutil.copytree(made, tmp_path / "run"))
    before_audit, _, _ = (folder / "events.jsonl").read_text("utf-8").partition('"kind":"rollout"')
    (folder / "events.jsonl").write_text(before_audit[: before_audit.rindex("\n") + 1], "utf-8")
    return folder


def call(
    *arguments: str,
    folder: Path,
    stdout: int | IO[bytes] = subprocess.PIPE,
    stderr: int | IO[bytes] = subprocess.PIPE,
    **environment: str,
) -> subprocess.CompletedProcess[bytes]:
    """The command as a shell starts it."""
    return subprocess.run(
        [sys.executable, "-m", "grs_agents", *arguments],
        cwd=folder,
        stdout=stdout,
        stderr=stderr,
        env={**os.environ, "PYTHONPATH": str(Path(__file__).parents[2]), **environment},
        check=False,
    )


@needs("/dev/full")
@pytest.mark.parametrize("verb", VERBS, ids=" ".join)
def test_a_full_output_is_one_line(run: Path, verb: tuple[str, ...]) -> None:
    with Path("/dev/full").open("wb") as full:
        done = call(*verb, folder=run.parent, stdout=full)
    assert done.returncode == 2
    assert done.stderr.startswith(b"grs: cannot write the output: No space left") and done.stderr.count(b"\n") == 1


@needs("/dev/full")
def test_a_full_error_output_leaves_the_exit_status(run: Path) -> None:
    with Path("/dev/full").open("wb") as full:
        assert call("show", "run", "--json", folder=run.parent, stderr=full).returncode == 0
        assert call("show", "nowhere", folder=run.parent, stderr=full).returncode == 2
        assert call("shwo", folder=run.parent, stderr=full).returncode == 2


@pytest.mark.parametrize("verb", VERBS[:3], ids=" ".join)
def test_a_narrow_encoding_spells_letters_out(run: Path, verb: tuple[str, ...]) -> None:
    done = call(*verb, folder=run.parent, PYTHONIOENCODING="ascii")
    assert (done.returncode, done.stderr) == (0, b"")
    assert done.stdout.isascii()
    assert (b"\\u2713 route" in done.stdout) == (verb == ("show", "run"))


def test_a_closed_output_is_no_file_of_a_verb(run: Path) -> None:
    script = 'exec "$0" -m grs_agents report run --out page.html >&- <&-'
    environment = {**os.environ, "PYTHONPATH": str(Path(__file__).parents[2])}
    done = subprocess.run(
        ["sh", "-c", script, sys.executable], cwd=run.parent, env=environment, capture_output=True, check=False
    )
    assert (done.returncode, done.stderr) == (0, b"")
    assert (run.parent / "page.html").read_bytes().endswith(b"</html>\n")


def test_who_reads_no_further_hears_nothing(run: Path) -> None:
    reader, writer = os.pipe()
    os.close(reader)
    with os.fdopen(writer, "wb") as output:
        done = call("show", "run", "--json", folder=run.parent, stdout=output)
    assert (done.returncode, done.stderr) == (1, b"")


@pytest.mark.parametrize("verb", [("show", "run"), ("run", "groceries", "--out", "new"), ("--help",)], ids=" ".join)
def test_too_few_open_files_are_one_line(run: Path, verb: tuple[str, ...]) -> None:
    done = subprocess.run(
        [sys.executable, "-m", "grs_agents", *verb],
        cwd=run.parent,
        env={**os.environ, "PYTHONPATH": str(Path(__file__).parents[2])},
        capture_output=True,
        check=False,
        preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_NOFILE, (20, 20)),
    )
    assert (done.returncode, done.stdout) == (2, b"")
    assert b"allows 20 open files" in done.stderr and b"ulimit -n" in done.stderr and done.stderr.count(b"\n") == 1
    assert not (run.parent / "new").exists()


def test_a_limit_that_may_be_raised_is(run: Path) -> None:
    highest = resource.getrlimit(resource.RLIMIT_NOFILE)[1]
    done = subprocess.run(
        [sys.executable, "-m", "grs_agents", "show", "run", "--json"],
        cwd=run.parent,
        env={**os.environ, "PYTHONPATH": str(Path(__file__).parents[2])},
        capture_output=True,
        check=False,
        preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_NOFILE, (20, highest)),
    )
    assert (done.returncode, done.stderr) == (0, b"")
