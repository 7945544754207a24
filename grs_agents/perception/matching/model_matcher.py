"""The matches that a model decides: among all assets, or among those that features propose."""

from collections.abc import Sequence

import numpy as np

from grs_agents.library.asset import Asset
from grs_agents.library.library import Library
from grs_agents.perception.matching.feature_matcher import TOLD, matchable_assets, rank_assets_per_segment
from grs_agents.perception.matching.types import MatchRequest, MatchResult
from grs_agents.perception.types import MatchEvidence, Shown


def match_by_model(
    request: MatchRequest, library: Library, method: str, *, worded: bool, pictured: bool
) -> MatchResult:
    """Ask the model about each candidate among all assets, with its description (``worded``) or its picture or both."""
    assets = matchable_assets(library)
    matches = {
        one.id: request.ask(one, shuffle_assets_for_prompt(assets, request.seed, one.id), worded, pictured).model_copy(
            update={"method": method}
        )
        for one in request.segments
    }
    return MatchResult(matches)


def match_by_features_and_model(request: MatchRequest, library: Library, method: str) -> MatchResult:
    """Ask the model about each candidate among the likeliest assets; it may still answer that it is none of them."""
    matches: dict[int, MatchEvidence] = {}
    ranked = rank_assets_per_segment(request, library)
    for one in request.segments:
        proposed, _ = ranked[one.id]
        scores = {
            name: round(value, 4) for name, value in zip(proposed.names[:TOLD], proposed.likelihoods, strict=False)
        }
        assets = [library.asset(name) for name in scores]
        said = request.ask(one, shuffle_assets_for_prompt(assets, request.seed, one.id), True, True)
        others = [name for name in scores if name != said.asset]
        matches[one.id] = said.model_copy(
            update={
                "method": method,
                "scores": scores,
                "confidence": round(proposed.confidence_of(said.asset), 4) if said.asset else None,
                "runner_up": others[0] if others else None,
            }
        )
    return MatchResult(matches)


def shuffle_assets_for_prompt(assets: Sequence[Asset], seed: int, number: int) -> list[Shown]:
    """Assets as a model is told of them, in an order drawn for each candidate, so that none gains by its position."""
    order = np.random.default_rng((seed, number)).permutation(len(assets))
    return [
        Shown(name=one.name, description=one.description, color=one.color, category=one.category, size=one.size)
        for one in (assets[int(index)] for index in order)
    ]
