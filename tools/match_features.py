"""Match candidates by measured size, by alignment of assets with the points, and by colours; no model is asked."""

from grs_agents.perception.matching.feature_matcher import match_by_features
from grs_agents.perception.matching.types import MatchRequest, MatchResult
from grs_agents.toolkit import ToolContext

Request, Result = MatchRequest, MatchResult


def run(request: MatchRequest, context: ToolContext) -> MatchResult:
    """The likeliest asset for each candidate, with its likelihood and the runner-up's.

    Raises:
        InputError: the files of an asset are faulty.
    """
    return match_by_features(request, context.library)
