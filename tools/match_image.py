"""Ask the model which asset a candidate's picture fits, without its description (the paper's 'image')."""

from grs_agents.perception.matching.model_matcher import match_by_model
from grs_agents.perception.matching.types import MatchRequest, MatchResult
from grs_agents.toolkit import ToolContext

Request, Result = MatchRequest, MatchResult


def run(request: MatchRequest, context: ToolContext) -> MatchResult:
    """The answer of the model for each candidate; the seed shuffles the assets in the prompt."""
    return match_by_model(request, context.library, "match_image", worded=False, pictured=True)
