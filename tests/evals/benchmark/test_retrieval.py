"""Retrieval at scale, at a small one: built in one process, probed in another, each figure told."""

from pathlib import Path

import pytest

from evals.benchmark.retrieval import measure_retrieval, retrieval_targets
from grs_agents.base.errors import GrsError


def test_an_index_is_built_and_probed(tmp_path: Path) -> None:
    figures = measure_retrieval(tmp_path / "index", 3000, 20, 0)
    assert figures["recall"] > 0.9
    assert figures["memory MiB"] > 50
    assert figures["open s"] >= 0
    assert {one.name for one in retrieval_targets(figures)} <= set(figures)
    names = ["add 1000 s", "memory MiB", "open s", "recall", "search ms, median"]
    assert sorted(one.name for one in retrieval_targets(figures)) == names


def test_what_fails_is_told(tmp_path: Path) -> None:
    (tmp_path / "index").mkdir()
    (tmp_path / "index" / "letter.txt").write_text("hello")
    with pytest.raises(GrsError, match="build of the index failed"):
        measure_retrieval(tmp_path / "index", 100, 5, 0)
