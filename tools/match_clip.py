"""Match candidates by CLIP similarity of pictures (the paper's baseline); the weights are the user's own."""

from grs_agents.perception.matching.clip_matcher import match_by_clip, open_clip_embedder
from grs_agents.perception.matching.types import MatchRequest, MatchResult
from grs_agents.toolkit import ToolContext

Request, Result = MatchRequest, MatchResult


def run(request: MatchRequest, context: ToolContext) -> MatchResult:
    """The most similar asset for each candidate; a candidate unlike all of them is no object.

    Raises:
        ConfigError: the model cannot be used.
        InputError: the files of an asset are faulty.
    """
    return match_by_clip(request, context.library, open_clip_embedder(request.model))
