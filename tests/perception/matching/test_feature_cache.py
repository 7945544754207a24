"""What was worked out of an asset is kept, by the hash of its files; what is broken or cannot be written is no harm."""

from pathlib import Path

import numpy as np
import pytest

from grs_agents.library.library import Library
from grs_agents.perception.matching.asset_appearance import (
    cache_folder_path,
    hash_asset_files,
    load_cached_arrays,
    save_cached_arrays,
)

ARRAYS = {"points": np.arange(6.0).reshape(2, 3), "cell": np.array(0.5)}


@pytest.fixture(autouse=True)
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    return tmp_path / "cache"


def test_arrays_come_back_as_they_were(cache: Path) -> None:
    assert load_cached_arrays("some") is None
    save_cached_arrays("some", ARRAYS)
    assert cache_folder_path() == cache / "grs-agents" / "looks"
    found = load_cached_arrays("some")
    assert found is not None
    assert {name: array.tolist() for name, array in found.items()} == {
        name: array.tolist() for name, array in ARRAYS.items()
    }


@pytest.mark.parametrize("content", [b"", b"PK\x03\x04 half a file", b"text"])
def test_a_broken_file_is_none(content: bytes) -> None:
    save_cached_arrays("some", ARRAYS)
    (cache_folder_path() / "some.npz").write_bytes(content)
    assert load_cached_arrays("some") is None


def test_a_cache_that_cannot_be_written_is_no_error(cache: Path) -> None:
    cache.write_text("a file where the folder should be")
    save_cached_arrays("some", ARRAYS)
    assert load_cached_arrays("some") is None


def test_another_file_is_another_key(tmp_path: Path) -> None:
    shipped = Library()
    milk, juice = hash_asset_files("HOPE/Milk.urdf", shipped), hash_asset_files("HOPE/OrangeJuice.urdf", shipped)
    assert milk != juice
    assert milk == hash_asset_files("HOPE/Milk.urdf", Library())
    cube, root = "block/red_block.urdf", tmp_path / "own"
    (root / "block").mkdir(parents=True)
    (root / cube).write_text(shipped.asset_path(cube).read_text() + "\n<!-- touched -->\n")
    (root / "manifest.json").write_text((shipped.roots[0] / "manifest.json").read_text())
    assert hash_asset_files(cube, Library(*shipped.roots, root)) != hash_asset_files(cube, shipped)


def test_a_user_without_a_home_is_no_error(monkeypatch: pytest.MonkeyPatch) -> None:
    def homeless() -> Path:
        raise RuntimeError("Could not determine home directory.")

    monkeypatch.delenv("XDG_CACHE_HOME")
    monkeypatch.setattr(Path, "home", homeless)
    save_cached_arrays("some", ARRAYS)
    assert load_cached_arrays("some") is None
