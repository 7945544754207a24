"""A scratch folder is gone afterwards; nothing else is."""

import os
import tempfile
from pathlib import Path

import pytest

from grs_agents.sandbox.protocol.scratch_folders import Scratch, remove_folder, remove_orphaned_folders


@pytest.fixture(autouse=True)
def temporary(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    return tmp_path


def test_it_is_private_and_empty() -> None:
    scratch = Scratch()
    assert scratch.path.stat().st_mode & 0o777 == 0o700
    assert not list(scratch.path.iterdir())
    scratch.remove()
    assert not scratch.path.exists()


def test_links_are_removed_not_followed(tmp_path: Path) -> None:
    kept = tmp_path / "kept"
    kept.mkdir(mode=0o755)
    (kept / "file").write_text("x")
    scratch = Scratch()
    (scratch.path / "inner").mkdir()
    (scratch.path / "inner" / "link").symlink_to(kept)
    (scratch.path / "link").symlink_to(kept)
    (scratch.path / "broken").symlink_to("nowhere")
    scratch.remove()
    assert not scratch.path.exists()
    assert (kept / "file").read_text() == "x"


def test_locked_folders_are_opened() -> None:
    scratch = Scratch()
    inner = scratch.path / "a" / "b" / "c"
    inner.mkdir(parents=True)
    (inner / "file").write_text("x")
    for locked in (inner, inner.parent, inner.parent.parent, scratch.path):
        locked.chmod(0)
    scratch.remove()
    assert not scratch.path.exists()


def test_a_missing_folder_is_no_error(tmp_path: Path) -> None:
    (tmp_path / "other").write_text("x")
    remove_folder(tmp_path / "missing")
    assert [path.name for path in tmp_path.iterdir()] == ["other"]


def test_sweep_takes_only_what_a_dead_host_left(tmp_path: Path) -> None:
    live, fresh = Scratch(), tmp_path / "grs-scratch-fresh"
    orphan, other = tmp_path / "grs-scratch-orphan", tmp_path / "other"
    for folder in (fresh, orphan, other):
        folder.mkdir()
    (orphan / "file").write_text("x")
    for old in (live.path, orphan, other):
        os.utime(old, (0, 0))
    remove_orphaned_folders()
    assert {folder.name for folder in tmp_path.iterdir()} == {live.path.name, "grs-scratch-fresh", "other"}
    live.remove()
