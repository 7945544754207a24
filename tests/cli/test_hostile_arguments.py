"""Arguments that no file can have, or that must not be read or replaced: each verb names them and ends with 2."""

import os
import stat
import sys
from pathlib import Path

import pytest

from grs_agents.cli.entry import main
from tests.cli.command import grs
from tests.cli.test_bad_input import copy_scene, set_camera
from tests.cli.test_foreign_folder import EVIL, assert_refused, made, run

__all__ = ["made", "run"]

TAKES_A_PATH = (
    ("run", "{}"),
    ("run", "{}", "--out", "run"),
    ("scene", "{}"),
    ("check", "{}"),
    ("check", "program.py", "--tests", "{}"),
    ("show", "{}"),
    ("replay", "{}"),
    ("report", "{}", "--out", "a.rrd"),
    ("report", "{}"),
    ("report", "{}", "--out", "a.webp"),
    ("replay", "{}", "--mujoco"),
    ("share", "{}"),
    ("config", "--config", "{}"),
    ("--content", "{}", "list"),
    ("assets", "import", "{}"),
    ("assets", "list", "--library", "{}"),
    ("assets", "verify", "--library", "{}"),
    ("assets", "index", "{}"),
    ("graph", "{}"),
    ("eval", "{}"),
)
NAMES = ("", "a" * 5_000, "a" * 300, "not-utf8-\udcff", "/dev/zero", "/dev/full", "missing" + EVIL)


@pytest.mark.parametrize("name", NAMES, ids=["empty", "5000", "300", "bytes", "zero", "full", "escapes"])
@pytest.mark.parametrize("verb", TAKES_A_PATH, ids=" ".join)
def test_a_name_that_no_file_can_have_is_refused(tmp_path: Path, verb: tuple[str, ...], name: str) -> None:
    (tmp_path / "program.py").write_text("pass\n")
    if name.startswith("missing") and verb[:2] == ("assets", "index"):
        pytest.skip("the folder of an index may have any name")
    done = grs(*(word.format(name) for word in verb), folder=tmp_path)
    assert_refused(done)
    assert not {"\x1b", "\x9b", "\u202e"} & set(done.stderr)


@pytest.mark.parametrize("name", ["", "a" * 5_000, "a" * 300, "not-utf8-\udcff", "pipe", "device", "folder"])
@pytest.mark.parametrize("verb", ["report", "share", "run", "assets show"])
def test_out_replaces_nothing_but_files(run: Path, verb: str, name: str) -> None:
    folder = run.parent
    os.mkfifo(folder / "pipe.gif")
    (folder / "device.gif").symlink_to("/dev/full")
    (folder / "folder.gif").mkdir()
    (folder / "folder.gif" / "kept").write_text("kept")
    source = {"run": "nowhere", "assets show": "bowl/bowl.urdf"}.get(verb, "run")
    out = f"{name}.gif" if name in ("pipe", "device", "folder") else name
    assert_refused(grs(*verb.split(), source, "--out", out, folder=folder))
    assert stat.S_ISFIFO((folder / "pipe.gif").lstat().st_mode)
    assert (folder / "device.gif").is_symlink() and stat.S_ISCHR(Path("/dev/full").stat().st_mode)
    assert (folder / "folder.gif" / "kept").read_text() == "kept"


def test_a_link_to_a_file_keeps_being_a_link(tmp_path: Path) -> None:
    (tmp_path / "sheet.png").write_text("old")
    (tmp_path / "latest.png").symlink_to("sheet.png")
    done = grs("assets", "show", "bowl/bowl.urdf", "--out", "latest.png", folder=tmp_path)
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "latest.png").is_symlink() and (tmp_path / "sheet.png").read_bytes().startswith(b"\x89PNG")


def test_a_dash_is_standard_output(
    run: Path, capsysbinary: pytest.CaptureFixture[bytes], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(run.parent)
    monkeypatch.setattr(sys, "argv", ["grs", "report", "run", "--out", "-"])
    with pytest.raises(SystemExit) as end:
        main()
    page = capsysbinary.readouterr().out
    assert not end.value.code and page.startswith(b"<!doctype html>") and page.endswith(b"</html>\n")
    assert not Path("-").exists()


def test_wrong_options_are_repeated_without_their_control_characters(tmp_path: Path) -> None:
    for arguments in (("show", "--" + EVIL), (EVIL,), ("eval", "router", "--" + EVIL)):
        done = grs(*arguments, folder=tmp_path)
        assert done.returncode == 2, done.stderr
        assert not {"\x1b", "\x9b", "\u202e"} & set(done.stdout + done.stderr)


def test_a_camera_cannot_command_the_terminal(tmp_path: Path, sample_scene: Path) -> None:
    scene = copy_scene(sample_scene, tmp_path)
    set_camera(scene, fx=EVIL)
    done = grs("scene", str(scene), "--out", "out", folder=tmp_path)
    assert done.returncode == 2 and not {"\x1b", "\x9b", "\u202e"} & set(done.stdout + done.stderr)


def test_a_program_that_is_checked_cannot_command_the_terminal(tmp_path: Path) -> None:
    raised = EVIL + "[bold]loud[/bold]"
    source = f"from grs_agents.sim import Task\nclass Evil(Task): ...\nraise ValueError({raised!r})\n"
    (tmp_path / "program.py").write_text(source)
    done = grs("check", "program.py", "--seeds", "1", folder=tmp_path)
    assert done.returncode == 1, done.stderr
    assert not {"\x1b", "\x9b", "\u202e"} & set(done.stdout + done.stderr)
    assert "loud" in done.stdout and "\\x1b" in done.stdout
