"""What a machine lacks is a reason to skip, is counted, and is made up for once it is there."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from tests.needs import needs

ROOT = Path(__file__).parents[1]
TESTS = """
import pytest
from tests.needs import needs, require

@pytest.fixture
def browser():
    require("browser")

@pytest.mark.parametrize("backend", [pytest.param("bubblewrap", marks=needs("bwrap")), "landlock"])
def test_backend(backend): pass

@needs("bwrap", "browser")
def test_both(): pass

def test_page(browser): pass

@needs("/")
def test_plain(): pass
"""


@pytest.fixture
def programs(tmp_path: Path) -> Path:
    """A project with the tests above, and an empty folder for the programs that the machine has."""
    (tmp_path / "conftest.py").write_text('pytest_plugins = ("tests.needs",)\n')
    (tmp_path / "pytest.ini").write_text("[pytest]\n")
    (tmp_path / "test_it.py").write_text(TESTS)
    (tmp_path / "bin").mkdir()
    return tmp_path / "bin"


def session(programs: Path, *options: str) -> tuple[int, str]:
    """The exit status of pytest where the machine has ``programs`` alone, and what it said."""
    command = [sys.executable, "-m", "pytest", "-q", "--strict-markers", "--rootdir", str(programs.parent), *options]
    environment = {**os.environ, "PATH": str(programs), "PYTHONPATH": str(ROOT), "PYTEST_DISABLE_PLUGIN_AUTOLOAD": "1"}
    done = subprocess.run(
        command, cwd=programs.parent, env=environment, capture_output=True, text=True, check=False, timeout=120
    )
    return done.returncode, done.stdout


def test_what_lacks_is_counted_and_made_up_for(programs: Path) -> None:
    options = ("-p", "xdist", "-n", "1")
    status, said = session(programs, *options)
    assert (status, "2 passed, 3 skipped" in said) == (0, True), said
    assert "2 bwrap (apt-get install bubblewrap)" in said
    assert "2 browser (apt-get install chromium chromium-driver)" in said
    (programs / "bwrap").symlink_to("/bin/true")
    status, said = session(programs, *options, "--skipped")
    assert (status, "1 passed, 2 skipped" in said) == (0, True), said
    assert "bwrap (" not in said
    (programs / "chromedriver").symlink_to("/bin/true")
    status, said = session(programs, "--skipped")
    assert (status, "2 passed" in said, "for want of" in said) == (0, True, False), said
    status, said = session(programs, "--skipped")
    assert status == 0
    assert "the last session skipped nothing" in said


def test_a_program_that_does_not_work_is_not_there(programs: Path) -> None:
    (programs / "bwrap").symlink_to("/bin/false")
    status, said = session(programs)
    assert (status, "2 passed, 3 skipped" in said) == (0, True), said
    assert "2 bwrap (" in said


def test_an_unknown_need_is_an_error() -> None:
    with pytest.raises(ValueError, match=r"no test can need \['bwarp'\].*bwrap"):
        needs("bwarp")
