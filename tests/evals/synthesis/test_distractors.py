"""Things that the library lacks are whole assets, of sizes that a table-top scene knows."""

from pathlib import Path

import numpy as np

from evals.synthesis.built_asset import write_assets
from evals.synthesis.distractors import build_distractors
from evals.synthesis.packages import FORMS
from evals.synthesis.products import build_products
from grs_agents.library.library import Library


def test_strange_things_are_assets_of_the_size_they_say(tmp_path: Path) -> None:
    names = write_assets(tmp_path, build_distractors(60, np.random.default_rng(0)))
    library = Library().copy_with_overlay_root(tmp_path)
    assert len({library.asset(name).kind for name in names}) == 9
    _check_sizes(names, library)


def test_absent_products_are_of_every_form_and_none_of_the_library(tmp_path: Path) -> None:
    names = write_assets(tmp_path, build_products(16, Library(), np.random.default_rng(0)))
    library = Library().copy_with_overlay_root(tmp_path)
    assert {library.asset(name).category for name in names[:8]} == {*FORMS, "mug"}
    assert len(set(names)) == 16
    assert not any(name in Library() for name in names)
    _check_sizes(names, library)


def _check_sizes(names: tuple[str, ...], library: Library) -> None:
    for name in names:
        model, asset = library.load_object_model(name), library.asset(name)
        assert np.allclose(model.size, asset.size, atol=2e-4)
        assert np.allclose(np.mean(model.bounds, axis=0), 0, atol=2e-4)
        assert model.colliders
        assert 0.005 < min(asset.size) <= max(asset.size) < 0.32


def test_the_same_seed_writes_the_same_things(tmp_path: Path) -> None:
    for folder in ("one", "other"):
        rng = np.random.default_rng(2)
        write_assets(tmp_path / folder, build_distractors(5, rng) + build_products(3, Library(), rng))
    files = sorted(file.relative_to(tmp_path / "one") for file in (tmp_path / "one").rglob("*.*"))
    assert files
    assert all((tmp_path / "one" / file).read_bytes() == (tmp_path / "other" / file).read_bytes() for file in files)
