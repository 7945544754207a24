"""Match by features: measurements of the camera against the assets of the library, without a model."""

from collections.abc import Mapping
from pathlib import Path

from grs_agents.base.errors import InputError
from grs_agents.library.asset import Asset
from grs_agents.library.library import Library
from grs_agents.perception.matching.asset_appearance import load_asset_appearances
from grs_agents.perception.matching.asset_index import AssetIndex, embed_object
from grs_agents.perception.matching.asset_ranking import (
    NOTHING_RANKED,
    RankedAssets,
    Use,
    explain_implausible_object,
    rank_assets_for_candidates,
)
from grs_agents.perception.matching.color_agreement import DAYLIGHT
from grs_agents.perception.matching.printed_text import load_ocr_reader, read_words
from grs_agents.perception.matching.segment_features import SegmentFeatures, extract_segment_features
from grs_agents.perception.matching.types import BY_FEATURES, MatchRequest, MatchResult
from grs_agents.perception.types import MatchEvidence

_LOOKED_UP = 40  # number of assets of an index that are compared with each candidate
TOLD = 5  # number of assets in the scores of a candidate


def matchable_assets(library: Library) -> tuple[Asset, ...]:
    """The assets that may be matched: everyday objects, without the proxies of other objects."""
    return tuple(asset for asset in library.everyday_assets() if asset.category != "proxy")


def match_by_features(request: MatchRequest, library: Library) -> MatchResult:
    """The likeliest asset for each candidate; ``no_asset`` where it is more likely wrong than right.

    Raises:
        InputError: the files of an asset are faulty.
    """
    use: Use = "all" if request.sized else "no size"
    return MatchResult(decide_by_features(rank_assets_per_segment(request, library, use)))


def decide_by_features(ranking: Mapping[int, tuple[RankedAssets, str]]) -> dict[int, MatchEvidence]:
    """The answers that follow from the rankings of `rank_assets_per_segment`, by number."""
    matches: dict[int, MatchEvidence] = {}
    for number, (ranked, implausible) in ranking.items():
        scores = {name: round(value, 4) for name, value in zip(ranked.names[:TOLD], ranked.likelihoods, strict=False)}
        if implausible:
            matches[number] = MatchEvidence(match="no_object", method=BY_FEATURES, scores=scores, reason=implausible)
            continue
        if not ranked.names:
            reason = "there is no asset to compare it with"
            matches[number] = MatchEvidence(match="no_asset", method=BY_FEATURES, reason=reason)
            continue
        sure, (first, *others) = ranked.confidences[0], ranked.names
        reason = f"{100 * sure:.0f} % certain: {ranked.reasons[0]}"
        wrong = sure <= 0.5
        matches[number] = MatchEvidence(
            match="no_asset" if wrong else "asset",
            asset=None if wrong else first,
            method=BY_FEATURES,
            confidence=round(1 - sure if wrong else sure, 4),
            scores=scores,
            runner_up=first if wrong else (others[0] if others else None),
            reason=f"{first} is {reason}" if wrong else reason,
        )
    return matches


def rank_assets_per_segment(
    request: MatchRequest, library: Library, use: Use = "all"
) -> dict[int, tuple[RankedAssets, str]]:
    """The ranking for each candidate, and the reason why it is no plausible object (empty if it is)."""
    if not request.segments:
        return {}
    frame, table = request.frame, request.table
    observed = [extract_segment_features(frame, table, item.mask, item.upright) for item in request.segments]
    assets = matchable_assets(library)
    if request.index is not None:
        index = AssetIndex(Path(request.index))
        if not len(index):
            raise InputError(f"the index in {index.folder} is empty", "fill it with `grs assets index`")
        names: set[str] = set()
        for seen in observed:
            query = embed_object(look=seen.untinted_color_histogram(DAYLIGHT.tint), size=seen.upright.size)
            names.update(name for name, _ in index.search(query, _LOOKED_UP))
        assets = tuple(library.asset(name) for name in sorted(names) if name in library)

    def read_words_on_candidate(seen: SegmentFeatures) -> list[str]:
        return read_words(frame, seen.mask)

    ranked = [NOTHING_RANKED] * len(observed)
    if assets:
        read = read_words_on_candidate if request.ocr and load_ocr_reader() is not None else None
        compared = load_asset_appearances(assets, library)
        ranked = rank_assets_for_candidates(compared, observed, frame, table, use, read)
    found = zip(request.segments, ranked, observed, strict=True)
    return {segment.id: (order, explain_implausible_object(seen)) for segment, order, seen in found}
