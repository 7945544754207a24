"""Match by a model: it chooses among all assets, or among the likeliest by features."""

from collections.abc import Sequence

import numpy as np

from grs_agents.library.asset import Asset
from grs_agents.library.library import Library
from grs_agents.perception.matching.feature_matcher import matchable_assets, rank_assets_per_segment, round_scores
from grs_agents.perception.matching.types import MatchRequest, MatchResult
from grs_agents.perception.types import MatchEvidence, Shown


def match_by_model(
    request: MatchRequest, library: Library, method: str, *, worded: bool, pictured: bool
) -> MatchResult:
    """Ask the model about each candidate among all assets, with its description (``worded``) or its picture or both."""
    assets = matchable_assets(library)
    matches: dict[int, MatchEvidence] = {}
    for segment in request.segments:
        shown = shuffle_assets_for_prompt(assets, request.seed, segment.id)
        answer = request.ask(segment, shown, worded, pictured)
        matches[segment.id] = answer.model_copy(update={"method": method})
    return MatchResult(matches)


def match_by_features_and_model(request: MatchRequest, library: Library, method: str) -> MatchResult:
    """Ask the model about each candidate among the likeliest assets; it may still reject all of them."""
    matches: dict[int, MatchEvidence] = {}
    ranking = rank_assets_per_segment(request, library)
    for segment in request.segments:
        ranked, _ = ranking[segment.id]
        scores = round_scores(ranked)
        assets = [library.asset(name) for name in scores]
        answer = request.ask(segment, shuffle_assets_for_prompt(assets, request.seed, segment.id), True, True)
        others = [name for name in scores if name != answer.asset]
        matches[segment.id] = answer.model_copy(
            update={
                "method": method,
                "scores": scores,
                "confidence": round(ranked.confidence_of(answer.asset), 4) if answer.asset else None,
                "runner_up": others[0] if others else None,
            }
        )
    return MatchResult(matches)


def shuffle_assets_for_prompt(assets: Sequence[Asset], seed: int, number: int) -> list[Shown]:
    """The rows of assets in a prompt, in an order drawn for each candidate, so that no asset gains by its position."""
    order = np.random.default_rng((seed, number)).permutation(len(assets))
    return [
        Shown(
            name=asset.name, description=asset.description, color=asset.color, category=asset.category, size=asset.size
        )
        for asset in (assets[int(index)] for index in order)
    ]
