"""How much a scratch folder holds, whatever was done to it."""

import os
from pathlib import Path

import pytest

from grs_agents.sandbox.isolation.resource_usage import ENTRY_BYTES, count_scratch_bytes, count_threads
from grs_agents.sandbox.protocol.scratch_folders import delete_folder_contents

MOST = 1 << 30


@pytest.fixture(params=["by handle", "by name"])
def _way(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    """Systems other than Linux have no handles to folders that cannot be read."""
    if request.param == "by name":
        monkeypatch.delattr(os, "O_PATH")


@pytest.mark.usefixtures("_way")
def test_every_entry_counts_and_links_are_not_followed(tmp_path: Path) -> None:
    outside, folder = tmp_path / "outside", tmp_path / "folder"
    inner = folder / "a" / "b"
    inner.mkdir(parents=True)
    outside.mkdir()
    (outside / "large").write_bytes(b"x" * (1 << 20))
    (inner / "file").write_bytes(b"x" * 10_000)
    (inner / "link").symlink_to(outside)
    taken = count_scratch_bytes(folder, MOST)
    assert 4 * ENTRY_BYTES + 10_000 <= taken < 1 << 20


@pytest.mark.usefixtures("_way")
def test_deep_folders_and_an_early_end(tmp_path: Path) -> None:
    here = Path.cwd()
    try:
        os.chdir(tmp_path)
        for _ in range(1100):
            Path("d").mkdir()
            os.chdir("d")
    finally:
        os.chdir(here)
    assert count_scratch_bytes(tmp_path, MOST) == 1100 * ENTRY_BYTES
    assert 0 < count_scratch_bytes(tmp_path, 10 * ENTRY_BYTES) <= 12 * ENTRY_BYTES
    delete_folder_contents(tmp_path)  # too deep for shutil.rmtree, which pytest uses


def test_threads_of_a_process() -> None:
    assert count_threads(os.getpid()) >= 1
    assert count_threads(1 << 30) == 0
