"""Results of reading files, kept until these change."""

from pathlib import Path

import pytest

from grs_agents.base.foreign.files import cache_until_modified


def test_a_file_is_read_again_only_after_it_was_modified(tmp_path: Path) -> None:
    reads: list[Path] = []

    @cache_until_modified(4)
    def read(path: Path) -> str:
        reads.append(path)
        return path.read_text("utf-8")

    file = tmp_path / "a.txt"
    file.write_text("old", "utf-8")
    assert (read(file), read(file), len(reads)) == ("old", "old", 1)
    file.write_text("newer", "utf-8")
    assert (read(file), len(reads)) == ("newer", 2)


def test_a_missing_file_is_for_the_function_to_report(tmp_path: Path) -> None:
    @cache_until_modified(4)
    def read(path: Path) -> str:
        raise LookupError(path.name)

    with pytest.raises(LookupError, match="gone"):
        read(tmp_path / "gone")
