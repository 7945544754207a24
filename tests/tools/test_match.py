"""The match tools: each loads, asks the model what it should be asked, or does without, and answers every candidate."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest

from evals.benchmark.ground_truth import read_labelled
from grs_agents.base.config.schema import Limits
from grs_agents.base.errors import ConfigError
from grs_agents.library.library import Library
from grs_agents.perception.matching.types import MatchRequest, MatchResult, Segment
from grs_agents.perception.segmentation.candidates import measure_candidates
from grs_agents.perception.table_finding import find_table
from grs_agents.perception.types import MatchEvidence, Shown
from grs_agents.sandbox.host.sandbox import Sandbox
from grs_agents.toolkit import ToolContext, load_tool


class Asked:
    """A model that takes the first asset it is shown, and remembers what it was given."""

    def __init__(self) -> None:
        self.told: list[tuple[int, int, bool, bool]] = []

    def __call__(self, segment: Segment, shown: Sequence[Shown], worded: bool, pictured: bool) -> MatchEvidence:
        self.told.append((segment.id, len(shown), worded, pictured))
        return MatchEvidence(match="asset", asset=shown[0].name, reason="it is the first")


def run(name: str, scene_folder: Path, asked: Asked, count: int = 2) -> tuple[MatchResult, list[Segment]]:
    scene = read_labelled(scene_folder)
    table = find_table(scene.frame, np.random.default_rng(0))
    found = measure_candidates(scene.frame, table, scene.labels)[:count]
    segments = [Segment(one.id, one.mask, one.upright, Path("crop.png"), one.points) for one in found]
    tool = load_tool(name)
    with Sandbox() as sandbox:
        context = ToolContext(sandbox=sandbox, library=Library(), limits=Limits())
        request = MatchRequest(segments, scene.frame, table, asked, ocr=False)
        return tool.run(request, context), segments


@pytest.mark.parametrize(
    ("name", "worded", "pictured"),
    [("match_text", True, False), ("match_image", False, True), ("match_both", True, True)],
)
def test_a_model_is_asked_among_all_assets(name: str, worded: bool, pictured: bool, sample_scene: Path) -> None:
    asked = Asked()
    found, segments = run(name, sample_scene, asked)
    things = len([one for one in Library().everyday_assets() if one.category != "proxy"])
    assert asked.told == [(one.id, things, worded, pictured) for one in segments]
    assert {one.method for one in found.matches.values()} == {name}
    assert set(found.matches) == {one.id for one in segments}


def test_the_hybrid_asks_among_five(sample_scene: Path) -> None:
    asked = Asked()
    found, segments = run("match_hybrid", sample_scene, asked)
    assert asked.told == [(one.id, 5, True, True) for one in segments]
    assert all(len(one.scores) == 5 and one.asset in one.scores for one in found.matches.values())


def test_features_ask_nobody_and_know_the_groceries(sample_scene: Path) -> None:
    asked = Asked()
    found, segments = run("match_features", sample_scene, asked, 5)
    assert asked.told == []
    labels, truth = read_labelled(sample_scene).labels, read_labelled(sample_scene).truth
    names = {one.id: one.asset for one in truth.objects}
    right = [found.matches[one.id].asset == names[int(np.bincount(labels[one.mask]).argmax())] for one in segments]
    assert sum(right) >= 4


def test_clip_needs_weights(sample_scene: Path) -> None:
    with pytest.raises(ConfigError, match=r"match\.model"):
        run("match_clip", sample_scene, Asked())
