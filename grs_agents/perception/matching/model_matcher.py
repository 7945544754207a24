"""Match by a model that sees: it chooses among the likeliest assets by features, for all candidates at once."""

from dataclasses import replace

from grs_agents.library.library import Library
from grs_agents.perception.matching.feature_matcher import (
    decide_by_features,
    match_by_features,
    matchable_assets,
    rank_assets_per_segment,
)
from grs_agents.perception.matching.types import MatchRequest, MatchResult
from grs_agents.perception.types import MatchEvidence, Shown


def match_by_features_and_model(request: MatchRequest, library: Library, method: str) -> MatchResult:
    """Ask the model once about all candidates, among the assets that features find likely for any of them.

    Assets are in the order of the library, so that prompts about similar photos begin alike. Features alone decide
    without a model, and about candidates without a usable reply.
    """
    if request.ask is None or not request.segments:
        return match_by_features(request, library)
    ranking = rank_assets_per_segment(replace(request, ocr=False), library)  # printed words change the order alone
    by_features = decide_by_features(ranking)
    likely = {name for ranked, _ in ranking.values() for name in ranked.names}
    shown = [
        Shown(
            name=asset.name, description=asset.description, color=asset.color, category=asset.category, size=asset.size
        )
        for asset in matchable_assets(library)
        if asset.name in likely
    ]
    if not shown:
        return MatchResult(by_features)
    answers = request.ask(request.segments, shown)
    matches: dict[int, MatchEvidence] = {}
    for number, measured in by_features.items():
        if number not in answers:
            matches[number] = measured
            continue
        answer = answers[number]
        rest = [name for name in measured.scores if name != answer.asset]
        matches[number] = answer.model_copy(
            update={
                "method": method,
                "scores": measured.scores,
                "runner_up": rest[0] if rest else None,
            }
        )
    return MatchResult(matches)
