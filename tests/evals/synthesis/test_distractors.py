"""Strange things are whole assets of a library folder, of sizes that a table-top scene knows."""

from pathlib import Path

import numpy as np

from evals.synthesis.distractors import write_distractors
from grs_agents.library import Library


def test_strange_things_are_assets_of_the_size_they_say(tmp_path: Path) -> None:
    names = write_distractors(tmp_path, 60, np.random.default_rng(0))
    library = Library().with_overlay(tmp_path)
    assert len({library.asset(name).kind for name in names}) == 9
    for name in names:
        model, asset = library.load_object_model(name), library.asset(name)
        assert np.allclose(model.size, asset.size, atol=2e-4)
        assert np.allclose(np.mean(model.bounds, axis=0), 0, atol=2e-4)
        assert model.colliders
        assert 0.005 < min(asset.size) <= max(asset.size) < 0.21


def test_the_same_seed_writes_the_same_things(tmp_path: Path) -> None:
    for folder in ("one", "other"):
        write_distractors(tmp_path / folder, 5, np.random.default_rng(2))
    files = sorted(file.relative_to(tmp_path / "one") for file in (tmp_path / "one").rglob("*.*"))
    assert files
    assert all((tmp_path / "one" / file).read_bytes() == (tmp_path / "other" / file).read_bytes() for file in files)
