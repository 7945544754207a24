"""Help and completion: the verbs in groups, each told in one whole line, and words that a shell completes."""

import re
from pathlib import Path

import pytest

from tests.cli.command import grs

GROUPS = ("Make", "Look", "Use", "Extend")


def test_verbs_stand_in_groups_each_in_one_whole_line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("COLUMNS", "80")
    text = grs("--help", folder=tmp_path).stdout
    assert re.findall(r"^(\w+):$", text, re.MULTILINE) == ["Options", *GROUPS]
    lines = text.partition("Make:\n")[2].splitlines()
    verbs = [line for line in lines if line and line.removesuffix(":") not in GROUPS]
    assert len(verbs) == 26
    assert all(re.fullmatch(r"  [a-z]+ +[A-Z].{20,}[a-z.\d]\.", line) and "..." not in line for line in verbs), verbs


def test_verbs_of_assets_are_whole_lines_too(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("COLUMNS", "80")
    verbs = grs("assets", "--help", folder=tmp_path).stdout.partition("Commands:\n")[2].splitlines()
    assert len(verbs) == 6 and all(line.endswith(".") and not line.endswith("...") for line in verbs), verbs


@pytest.mark.parametrize(
    ("line", "words"),
    [
        ("grs ins", ["instances"]),
        ("grs run gro", ["groceries"]),
        ("grs run my-ph", ["my-photos"]),
        ("grs run my-photos/o", ["my-photos/one"]),
        ("grs run groceries --set max_fi", ["max_fixes="]),
        ("grs run groceries --set limits.wall", ["limits.wall_seconds="]),
        ("grs run --cassette groceries-t", ["groceries-tidy"]),
        ("grs graph no_r", ["no_router"]),
        ("grs eval routi", ["routing"]),
        ("grs show l", ["latest"]),
        ("grs show runs/", ["runs/one"]),
        ("grs export runs/", ["runs/one"]),
        ("grs run nowhere/else/", []),
    ],
)
def test_a_shell_completes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, line: str, words: list[str]) -> None:
    (tmp_path / "my-photos" / "one").mkdir(parents=True)
    (tmp_path / "runs" / "one").mkdir(parents=True)
    (tmp_path / "runs" / "one" / "run.json").write_text("{}", "utf-8")
    monkeypatch.setenv("_GRS_COMPLETE", "complete_bash")
    monkeypatch.setenv("COMP_WORDS", line)
    monkeypatch.setenv("COMP_CWORD", str(len(line.split()) - 1))
    done = grs(folder=tmp_path)
    assert (done.returncode, done.stdout.split(), done.stderr) == (0, words, "")
