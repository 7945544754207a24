"""Content is found by name; a folder of the user's own wins; a name nothing has lists those there are."""

import re
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from grs_agents.base import content
from grs_agents.base.errors import ConfigError, InputError, UnknownNameError

OURS = """
\"\"\"A graph of the user's own.\"\"\"
from dataclasses import dataclass

@dataclass
class State:
    note: "str | None" = None
"""


@pytest.fixture
def overlay(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """A content folder with one graph of the user's own, laid over for one test."""
    monkeypatch.setattr(content, "_overlays", [])
    before = set(sys.modules)
    (tmp_path / "graphs").mkdir()
    (tmp_path / "graphs" / "ours.py").write_text(OURS)
    (tmp_path / "graphs" / "_private.py").write_text(OURS)
    content.add_overlay_folder(tmp_path)
    yield tmp_path
    for name in set(sys.modules) - before:
        if name.startswith("grs_content."):
            del sys.modules[name]


@pytest.mark.parametrize("kind", content.KINDS)
def test_every_kind_ships_with_content(kind: content.Kind) -> None:
    names = content.content_names(kind)
    assert names == sorted(set(names))
    assert names, f"no {kind} are shipped"
    assert all(content.content_path(kind, name).exists() for name in names)


@pytest.mark.parametrize("kind", ["graphs", "tools", "evals"])
def test_every_shipped_python_file_loads_once_and_says_what_it_is(kind: content.Kind) -> None:
    for name in content.content_names(kind):
        module = content.load_module(kind, name)
        assert content.load_module(kind, name) is module
        assert (module.__doc__ or "").strip(), f"{kind}/{name}.py has no first line to show in `grs list`"


def test_content_files_do_not_know_each_other() -> None:
    shared = re.compile(r"from evals\.(benchmark|faults|synthesis)\b")  # of the experiments that only a checkout has
    for kind in ("graphs", "tools", "evals"):
        for name in content.content_names(kind):
            text = shared.sub("", content.content_path(kind, name).read_text(encoding="utf-8"))
            assert not any(f"{word} {kind}." in text for word in ("import", "from") for kind in content.KINDS)


def test_an_overlay_adds_names_and_loads(overlay: Path) -> None:
    assert "ours" in content.content_names("graphs")
    assert "grs" in content.content_names("graphs")
    assert content.content_path("graphs", "ours") == overlay.resolve() / "graphs" / "ours.py"
    assert content.load_module("graphs", "ours").State().note is None


def test_an_overlay_wins_over_the_shipped_file(overlay: Path) -> None:
    shipped = content.load_module("graphs", "grs")
    (overlay / "graphs" / "grs.py").write_text(OURS)
    assert content.content_path("graphs", "grs").is_relative_to(overlay.resolve())
    assert content.load_module("graphs", "grs") is not shipped
    del sys.modules["grs_content.graphs.grs"]


def test_names_that_start_with_an_underscore_are_private(overlay: Path) -> None:
    assert "_private" not in content.content_names("graphs")
    with pytest.raises(UnknownNameError):
        content.content_path("graphs", "_private")


def test_an_unknown_name_lists_the_nearest_first() -> None:
    with pytest.raises(
        UnknownNameError, match=r"unknown graph 'no_ruter'; did you mean no_router\? use one of: no_router"
    ):
        content.content_path("graphs", "no_ruter")


@pytest.mark.parametrize("name", ["../grs_agents/base/errors", "/etc/passwd", "", ".", ".."])
def test_a_name_is_never_a_way_out_of_its_folder(name: str) -> None:
    for kind in content.KINDS:
        with pytest.raises(UnknownNameError):
            content.content_path(kind, name)


def test_a_file_that_does_not_import_leaves_no_half_module(overlay: Path) -> None:
    (overlay / "tools").mkdir()
    (overlay / "tools" / "broken.py").write_text("raise RuntimeError('broken here')")
    for _ in range(2):
        with pytest.raises(ConfigError, match=r"tool 'broken' .*broken\.py:1: RuntimeError: broken here"):
            content.load_module("tools", "broken")


def test_a_missing_overlay_is_an_input_error(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"nowhere does not exist.*--content"):
        content.add_overlay_folder(tmp_path / "nowhere")
