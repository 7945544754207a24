"""The match tools: each loads, asks the model what it should be asked, or does without, and answers every candidate."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest

from evals.benchmark.ground_truth import read_labelled
from grs_agents.base.config.schema import Limits
from grs_agents.base.errors import ConfigError, UnknownNameError
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
        self.told: list[tuple[list[int], int]] = []

    def __call__(self, segments: Sequence[Segment], shown: Sequence[Shown]) -> dict[int, MatchEvidence]:
        self.told.append(([one.id for one in segments], len(shown)))
        answer = MatchEvidence(match="asset", asset=shown[0].name, reason="it is the first")
        return {one.id: answer for one in segments}


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


def test_the_hybrid_asks_once_among_the_likely_assets(sample_scene: Path) -> None:
    asked = Asked()
    found, segments = run("match_hybrid", sample_scene, asked)
    ((numbers, shown),) = asked.told
    assert numbers == [one.id for one in segments] and 10 <= shown <= 20
    assert {one.method for one in found.matches.values()} == {"match_hybrid"}


@pytest.mark.parametrize("name", ["match_both", "match_text", "match_image"])
def test_a_tool_of_an_earlier_version_is_refused_with_those_there_are(name: str, sample_scene: Path) -> None:
    with pytest.raises(UnknownNameError, match="match_hybrid"):
        run(name, sample_scene, Asked())


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
