"""Folders from somebody else that a verb writes into: nothing is written through their links, and nothing waits."""

import json
import os
import shutil
import sqlite3
from pathlib import Path

import pytest

from grs_agents.runs.hashes import write_hashes
from grs_agents.runs.sharing import make_scrubber
from tests import bombs
from tests.cli.command import grs
from tests.cli.test_foreign_folder import assert_refused, made, run

__all__ = ["made", "run"]  # fixtures


@pytest.mark.parametrize("kind", ["file", "folder", "pipe"])
def test_a_batch_writes_through_no_link(tmp_path: Path, sample_scene: Path, kind: str) -> None:
    (tmp_path / "b").mkdir()
    victim = tmp_path / "victim"
    if kind == "file":
        victim.write_text("mine")
        (tmp_path / "b" / "groceries-0.log").symlink_to(victim)
    elif kind == "folder":
        victim.mkdir()
        (tmp_path / "b" / "groceries-0").symlink_to(victim)
    else:
        os.mkfifo(tmp_path / "b" / "groceries-0.log")
    done = grs("batch", str(sample_scene), "--out", "b", "-q", folder=tmp_path)
    assert done.returncode != 0, done.stdout
    assert kind == "pipe" or (victim.read_text() == "mine" if kind == "file" else not list(victim.iterdir()))


@pytest.mark.parametrize("text", [None, "[" * 100_000, "[]"], ids=["pipe", "deep", "list"])
def test_a_batch_file_that_is_none_is_refused(tmp_path: Path, sample_scene: Path, text: str | None) -> None:
    (tmp_path / "b").mkdir()
    os.mkfifo(tmp_path / "b" / "batch.json") if text is None else (tmp_path / "b" / "batch.json").write_text(text)
    assert_refused(grs("batch", str(sample_scene), "--out", "b", folder=tmp_path), "batch.json")


def test_a_link_to_a_folder_is_no_part_of_a_run(run: Path) -> None:
    (run / "again").symlink_to(".")
    assert_refused(grs("show", "run", folder=run.parent), "again is a link to a folder")


def test_runs_of_alike_lines_are_compared_at_once(run: Path) -> None:
    second = Path(shutil.copytree(run, run.parent / "second"))
    for folder, name, shift in ((run, "x", 0), (second, "y", 10_000)):
        lines = (f"{name} = foo(alpha, beta, gamma, {number + shift})\n" for number in range(700))
        (folder / "simulation.py").write_text("".join(lines))
    done = grs("compare", "run", "second", "--json", folder=run.parent)
    assert done.returncode == 0 and "1400 lines differ" in done.stdout


def test_a_checkpoint_makes_up_no_value(run: Path) -> None:
    with sqlite3.connect(run / "checkpoint.sqlite") as database:
        made_up = "checkpoint BLOB GENERATED ALWAYS AS (zeroblob(900000000)) VIRTUAL"
        keys = "thread_id TEXT, checkpoint_ns TEXT, checkpoint_id TEXT, parent_checkpoint_id TEXT, type TEXT"
        database.execute(f"CREATE TABLE checkpoints ({keys}, {made_up}, metadata BLOB)")
        database.execute("INSERT INTO checkpoints VALUES ('sample-run', '', '1', NULL, 'msgpack', '{}')")
        database.execute("CREATE TABLE writes (thread_id TEXT)")
    (run.parent / "photo").mkdir()
    done = grs("run", "/photo", "--out", "run", "--resume", folder=run.parent)
    assert_refused(done, "checkpoint.sqlite")


def test_a_file_name_adds_no_line_to_a_verification(run: Path) -> None:
    write_hashes(run)
    (run / "x\nreport.html: it holds").touch()
    done = grs("verify", "run", folder=run.parent)
    assert (done.returncode, len(done.stdout.splitlines())) == (1, 2), done.stdout
    assert r"x\nreport.html: it holds: it was added" in done.stdout


@pytest.mark.parametrize(("verb", "name"), [(("share",), "run.zip"), (("instances", "--seeds", "0"), "run-instances")])
def test_an_output_that_nobody_named_is_written_through_no_link(run: Path, verb: tuple[str, ...], name: str) -> None:
    victim = run.parent / "victim"
    victim.write_text("mine") if name.endswith(".zip") else victim.mkdir()
    (run.parent / name).symlink_to(victim)
    assert_refused(grs(verb[0], "run", *verb[1:], folder=run.parent), f"{name} is a link")
    assert victim.read_text() == "mine" if victim.is_file() else not list(victim.iterdir())


def test_a_waiting_run_without_a_checkpoint_is_not_begun_anew(run: Path) -> None:
    record = json.loads((run / "run.json").read_text("utf-8"))
    question = {"text": "go on?", "details": "", "choices": ["yes", "no"]}
    (run / "run.json").write_text(json.dumps({**record, "status": "waiting", "question": question}), "utf-8")
    assert_refused(grs("approve", "run", "--reply", "yes", folder=run.parent), "no checkpoint.sqlite to go on from")


@pytest.mark.parametrize("word", ["-eyJ", "-----BEGIN PRIVATE KEY-----\n"])
def test_text_is_scrubbed_in_one_pass(word: str) -> None:
    scrubber = make_scrubber(Path("/nowhere"))
    assert scrubber.remove_secrets(word * 100_000).startswith(word[:4])
    assert "eyJhbGciOiJI" not in scrubber.remove_secrets('{"key": "eyJhbGciOiJI.eyJzdWIiOiIx.SflKxwRJSMeK"}')


def test_a_program_too_long_to_be_parsed_is_refused_by_its_length(tmp_path: Path) -> None:
    (tmp_path / "program.py").write_text('a = 0\nX = f"' + "{a}" * 100_000 + '"\n')
    done = grs("check", "program.py", "--seeds", "1", "--json", folder=tmp_path)
    assert done.returncode == 1 and "300014 characters, more than 131072" in done.stdout, (
        done.stdout[:2000] + done.stderr
    )


def test_a_picture_of_a_run_is_no_larger_than_a_photo_becomes(run: Path) -> None:
    bombs.png(run / "rgb.png", 8_000, 8_000)
    done = grs("report", "run", "--out", "trace.rrd", folder=run.parent)
    assert_refused(done, "8000x8000 pixels, more than 16000000")
