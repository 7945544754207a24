"""Ask the model which asset a candidate's description fits, without its picture (the paper's 'text')."""

from grs_agents.perception.matching.model_matcher import match_by_model
from grs_agents.perception.matching.types import MatchRequest, MatchResult
from grs_agents.toolkit import ToolContext

Request, Result = MatchRequest, MatchResult


def run(request: MatchRequest, context: ToolContext) -> MatchResult:
    """The answer of the model for each candidate; the seed shuffles the assets in the prompt."""
    return match_by_model(request, context.library, "match_text", worded=True, pictured=False)
