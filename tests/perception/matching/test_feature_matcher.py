"""Matching by features and by a model, on a small synthesised scene with its true masks."""

import shutil
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from evals.synthesis import Recipe
from grs_agents.base.errors import ConfigError
from grs_agents.library.asset import AssetManifest
from grs_agents.library.library import Library
from grs_agents.perception.matching.clip_matcher import Picture, match_by_clip, open_clip_embedder
from grs_agents.perception.matching.feature_matcher import match_by_features, matchable_assets
from grs_agents.perception.matching.model_matcher import match_by_features_and_model
from grs_agents.perception.matching.types import MatchRequest, Segment
from grs_agents.perception.types import MatchEvidence, Shown
from tests.perception.matching.photo import request_of, unasked

LIBRARY = Library()


@pytest.fixture(scope="module")
def photo() -> tuple[MatchRequest, dict[int, str]]:
    """Three things of the library and a strange one, with the names of the assets by segment."""
    return request_of(Recipe(seed=3, objects=4, distractors=1, tilt=45, width=480, height=360), LIBRARY)


def test_features_find_most_assets_and_leave_the_strange_alone(photo: tuple[MatchRequest, dict[int, str]]) -> None:
    request, names = photo
    found = match_by_features(request, LIBRARY).matches
    right = [number for number, name in names.items() if name and found[number].asset == name]
    assert len(right) >= 2
    for number in right:
        answer = found[number]
        assert answer.method == "match_features"
        assert answer.confidence is not None
        assert 0.3 < answer.confidence <= 1
        assert answer.runner_up != answer.asset
        assert sum(answer.scores.values()) <= 1 + 1e-3
        assert "mm off the points" in answer.reason
    assert all(found[number].asset is None for number, name in names.items() if not name)


def test_a_sliver_is_no_object(photo: tuple[MatchRequest, dict[int, str]]) -> None:
    request, _ = photo
    one = request.segments[0]
    flat = one.upright.model_copy(update={"size": (0.1, 0.05, 0.002)})
    thin = Segment(one.id, one.mask, flat, one.crop, one.points)
    alone = MatchRequest([thin], request.frame, request.table, unasked)
    assert match_by_features(alone, LIBRARY).matches[one.id].match == "no_object"


def test_a_model_is_asked_once_among_likely_assets_in_the_order_of_the_library(
    photo: tuple[MatchRequest, dict[int, str]],
) -> None:
    request, names = photo
    told: list[tuple[list[int], list[str]]] = []

    def ask(segments: Sequence[Segment], assets: Sequence[Shown]) -> dict[int, MatchEvidence]:
        told.append(([one.id for one in segments], [one.name for one in assets]))
        return {segments[0].id: MatchEvidence(match="asset", asset=assets[0].name, confidence=0.95, reason="its words")}

    found = match_by_features_and_model(replace(request, ask=ask), LIBRARY, "match_hybrid").matches
    ((numbers, shown),) = told
    assert numbers == [one.id for one in request.segments]
    assert shown == [one.name for one in matchable_assets(LIBRARY) if one.name in shown]
    known = [name for name in names.values() if name in {one.name for one in matchable_assets(LIBRARY)}]
    assert len(set(known) & set(shown)) >= 0.9 * len(set(known))
    answered, *silent = (found[number] for number in numbers)
    assert (answered.asset, answered.confidence, answered.method) == (shown[0], 0.95, "match_hybrid")
    assert len(answered.scores) == 5 and answered.runner_up != shown[0]
    assert {one.method for one in silent} == {"match_features"}
    assert match_by_features_and_model(replace(request, ask=None), LIBRARY, "match_hybrid") == match_by_features(
        request, LIBRARY
    )


def test_clip_takes_the_most_similar_or_none(photo: tuple[MatchRequest, dict[int, str]], tmp_path: Path) -> None:
    request, _ = photo
    names = ("HOPE/Corn.urdf", "HOPE/Milk.urdf", "HOPE/Mustard.urdf")  # drawing all assets takes 13 s
    shutil.copytree(LIBRARY.roots[0] / "HOPE", tmp_path / "HOPE")
    manifest = AssetManifest(assets=tuple(LIBRARY.asset(name) for name in names))
    (tmp_path / "manifest.json").write_text(manifest.model_dump_json())
    few = Library(tmp_path)

    def colors(pictures: Sequence[Picture]) -> np.ndarray:
        means = np.array([picture.reshape(-1, 3).mean(axis=0) for picture in pictures]) + 1.0
        return means / np.linalg.norm(means, axis=1, keepdims=True)

    alike = match_by_clip(request, few, colors).matches
    assert all(
        one.match == "asset" and one.scores[one.asset or ""] >= 0.5 and one.asset in names for one in alike.values()
    )

    def opposite(pictures: Sequence[Picture]) -> np.ndarray:
        return colors(pictures) * (-1.0 if len(pictures) == len(request.segments) else 1.0)

    assert all(one.match == "no_object" for one in match_by_clip(request, few, opposite).matches.values())


def test_clip_without_weights_says_how_to_get_them(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"match\.model"):
        open_clip_embedder(None)
    with pytest.raises(ConfigError, match="open_clip_config"):
        open_clip_embedder(str(tmp_path))
