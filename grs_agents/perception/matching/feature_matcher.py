"""The match by features: what the camera measured against what the library holds, without any model."""

from collections.abc import Sequence
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
from grs_agents.perception.matching.observation import Observation, View, observe_candidate
from grs_agents.perception.matching.printed_text import load_ocr_reader, read_words
from grs_agents.perception.matching.types import MatchRequest, MatchResult
from grs_agents.perception.types import MatchEvidence

_LOOKED_UP = 40  # so many assets of an index are compared with each candidate
TOLD = 5  # so many assets are told of each candidate


def matchable_assets(library: Library) -> tuple[Asset, ...]:
    """The assets that may be matched: what can stand on a table, proxies of other objects aside."""
    return tuple(asset for asset in library.everyday_assets() if asset.category != "proxy")


def match_by_features(request: MatchRequest, library: Library, method: str) -> MatchResult:
    """The likeliest asset for each candidate; ``no_asset`` where it is likelier to be the wrong one.

    Raises:
        InputError: the files of an asset are faulty.
    """
    matches: dict[int, MatchEvidence] = {}
    for number, (ranked, reason) in rank_assets_per_segment(
        request, library, "all" if request.sized else "no size"
    ).items():
        matches[number] = _build_match_evidence(ranked, reason, method)
    return MatchResult(matches)


def rank_assets_per_segment(
    request: MatchRequest, library: Library, use: Use = "all"
) -> dict[int, tuple[RankedAssets, str]]:
    """The ranking of each candidate; and why it is no object, if it is none."""
    if not request.segments:
        return {}
    view = View(request.frame, request.table)
    observed = [observe_candidate(view, one.mask, one.upright) for one in request.segments]
    assets = (
        matchable_assets(library)
        if request.index is None
        else _search_asset_index(Path(request.index), observed, library)
    )

    reads = request.ocr and load_ocr_reader() is not None

    def read_words_on_candidate(seen: Observation) -> list[str]:
        return read_words(request.frame, seen.mask)

    ranked = (
        rank_assets_for_candidates(
            load_asset_appearances(assets, library), observed, view, use, read_words_on_candidate if reads else None
        )
        if assets
        else []
    )
    ranked = ranked or [NOTHING_RANKED] * len(observed)
    found = zip(request.segments, ranked, observed, strict=True)
    return {segment.id: (order, explain_implausible_object(seen)) for segment, order, seen in found}


def _search_asset_index(folder: Path, observed: Sequence[Observation], library: Library) -> tuple[Asset, ...]:
    """The assets of an index that look most like one of the candidates, as far as the library still has them."""
    index = AssetIndex(folder)
    if not len(index):
        raise InputError(f"the index in {folder} is empty", "fill it with `grs assets index`")
    names: set[str] = set()
    for seen in observed:
        query = embed_object(look=seen.untinted_color_histogram(DAYLIGHT.tint), size=seen.upright.size)
        names.update(name for name, _ in index.search(query, _LOOKED_UP))
    return tuple(library.asset(name) for name in sorted(names) if name in library)


def _build_match_evidence(ranked: RankedAssets, nothing: str, method: str) -> MatchEvidence:
    scores = {name: round(value, 4) for name, value in zip(ranked.names[:TOLD], ranked.likelihoods, strict=False)}
    if nothing:
        return MatchEvidence(match="no_object", method=method, scores=scores, reason=nothing)
    if not ranked.names:
        return MatchEvidence(match="no_asset", method=method, reason="there is no asset to compare it with")
    sure, (first, *others) = ranked.confidences[0], ranked.names
    reason = f"{100 * sure:.0f} % certain: {ranked.reasons[0]}"
    if sure <= 0.5:
        answer = MatchEvidence(
            match="no_asset", confidence=round(1 - sure, 4), runner_up=first, reason=f"{first} is {reason}"
        )
    else:
        runner_up = others[0] if others else None
        answer = MatchEvidence(
            match="asset", asset=first, confidence=round(sure, 4), runner_up=runner_up, reason=reason
        )
    return answer.model_copy(update={"method": method, "scores": scores})
