"""Propose assets by features, and ask a model that sees about all objects at once; without one, features decide."""

from grs_agents.perception.matching.model_matcher import match_by_features_and_model
from grs_agents.perception.matching.types import MatchRequest, MatchResult
from grs_agents.toolkit import ToolContext

Request, Result = MatchRequest, MatchResult


def run(request: MatchRequest, context: ToolContext) -> MatchResult:
    """The answer of the model for each candidate, with the likelihoods of the best assets by features.

    Raises:
        InputError: the files of an asset are faulty.
    """
    return match_by_features_and_model(request, context.library, "match_hybrid")
