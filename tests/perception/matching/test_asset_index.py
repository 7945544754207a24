"""The index of assets: what was added is found, before and after it is sorted, and after it is opened again."""

from pathlib import Path

import numpy as np
import pytest

from evals.benchmark.retrieval import synthetic_vectors
from grs_agents.base.errors import InputError
from grs_agents.perception.matching.asset_index import DIMENSIONS, AssetIndex, embed_object

NAMES = [f"asset/{number}" for number in range(3000)]
VECTORS = synthetic_vectors(3000, np.random.default_rng(0))


def test_few_are_found_without_faiss(tmp_path: Path) -> None:
    index = AssetIndex(tmp_path / "index")
    index.add(NAMES[:50], VECTORS[:50])
    again = AssetIndex(tmp_path / "index")
    assert len(again) == 50
    assert again.search(VECTORS[7], 3)[0][0] == "asset/7"
    nearest = np.argsort(-VECTORS[:50] @ VECTORS[7], kind="stable")
    assert [name for name, _ in again.search(VECTORS[7], 50)] == [NAMES[number] for number in nearest]


def test_a_name_is_replaced_and_forgotten(tmp_path: Path) -> None:
    index = AssetIndex(tmp_path)
    index.add(NAMES[:10], VECTORS[:10])
    index.add(["asset/3"], VECTORS[100:101])
    assert len(index) == 10
    assert index.search(VECTORS[100], 1)[0][0] == "asset/3"
    index.remove(["asset/3", "never there"])
    assert "asset/3" not in AssetIndex(tmp_path)
    assert "asset/3" not in [name for name, _ in index.search(VECTORS[100], 10)]


def test_many_are_sorted_and_grow_in_place(tmp_path: Path) -> None:
    index = AssetIndex(tmp_path)
    index.add(NAMES[:2500], VECTORS[:2500])
    index.add(NAMES[2500:], VECTORS[2500:])
    again = AssetIndex(tmp_path)
    assert again.names() == NAMES
    for number in (5, 2600):
        assert again.search(VECTORS[number], 5)[0][0] == f"asset/{number}"
    again.remove(NAMES[:100])
    again.compact()
    assert len(again) == 2900
    assert AssetIndex(tmp_path).names() == NAMES[100:]
    assert not again.needs_compaction


def test_an_interrupted_addition_leaves_no_trace(tmp_path: Path) -> None:
    index = AssetIndex(tmp_path)
    index.add(NAMES[:5], VECTORS[:5])
    with (tmp_path / "0.f32").open("ab") as torn:
        torn.write(b"half a vector")
    index = AssetIndex(tmp_path)
    index.add(NAMES[5:7], VECTORS[5:7])
    assert AssetIndex(tmp_path).search(VECTORS[6], 1)[0][0] == "asset/6"


def test_what_is_no_index_is_named(tmp_path: Path) -> None:
    (tmp_path / "notes.txt").write_text("mine")
    with pytest.raises(InputError, match="other things"):
        AssetIndex(tmp_path)
    (tmp_path / "index.json").write_text("{")
    with pytest.raises(InputError, match="broken"):
        AssetIndex(tmp_path)


@pytest.mark.parametrize(
    ("names", "vectors", "named"),
    [
        (["a"], np.zeros((2, DIMENSIONS), np.float32), "1 names"),
        (["a", "a"], np.zeros((2, DIMENSIONS), np.float32), "twice"),
        (["a"], np.full((1, DIMENSIONS), np.nan, np.float32), "not finite"),
    ],
)
def test_bad_vectors_are_refused(tmp_path: Path, names: list[str], vectors: np.ndarray, named: str) -> None:
    with pytest.raises(InputError, match=named):
        AssetIndex(tmp_path / "index").add(names, vectors)
    assert not (tmp_path / "index").exists()


def test_alike_things_have_alike_vectors() -> None:
    soup = embed_object("a red can of tomato soup", size=(0.07, 0.07, 0.1))
    stew = embed_object("a red can of tomato stew", size=(0.1, 0.068, 0.07))
    book = embed_object("an old blue book", size=(0.2, 0.14, 0.03))
    assert soup @ stew > 0.4
    assert soup @ book < 0.2
    assert soup @ soup == pytest.approx(0.7, abs=1e-5)
