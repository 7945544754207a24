"""The match by features: what the camera measured against what the library holds, without any model."""

from collections.abc import Sequence

from grs_agents.correspondence.catalogue import Catalogue, catalogue_of
from grs_agents.correspondence.observation import Observation, View, observe, view_of
from grs_agents.correspondence.ranking import Ranked, Use, implausible, rank
from grs_agents.correspondence.types import MatchRequest, MatchResult
from grs_agents.library import Asset, Library
from grs_agents.scene import MatchEvidence

LEAST = 0.5
"""An asset is matched if it is likelier than not."""
TOLD = 5
"""So many assets are told of each candidate."""


def offered(library: Library) -> tuple[Asset, ...]:
    """The assets that may be matched: things that can stand on a table, proxies of other objects aside."""
    return tuple(asset for asset in library.things() if asset.category != "proxy")


def by_features(request: MatchRequest, library: Library, method: str, use: Use = "all") -> MatchResult:
    """The likeliest asset for each candidate; ``no_asset`` where none is likelier than not.

    Raises:
        InputError: the files of an asset are faulty.
    """
    matches: dict[int, MatchEvidence] = {}
    for number, (ranked, reason) in ranked_of(request, library, use).items():
        matches[number] = _answer(ranked, reason, method)
    return MatchResult(matches)


def ranked_of(request: MatchRequest, library: Library, use: Use = "all") -> dict[int, tuple[Ranked, str]]:
    """The ranking of each candidate; and why it is no object, if it is none."""
    if not request.segments:
        return {}
    view = view_of(request.frame, request.table)
    observed = [observe(view, one.mask, one.upright) for one in request.segments]
    ranked = _all_ranked(catalogue_of(offered(library), library), observed, view, use)
    return {
        one.id: (found, implausible(seen))
        for one, found, seen in zip(request.segments, ranked, observed, strict=True)
    }  # fmt: skip


def _all_ranked(catalogue: Catalogue, observed: Sequence[Observation], view: View, use: Use) -> list[Ranked]:
    return [ranked for ranked, _ in rank(catalogue, observed, view, use)]


def _answer(ranked: Ranked, nothing: str, method: str) -> MatchEvidence:
    scores = {name: round(value, 4) for name, value in zip(ranked.names[:TOLD], ranked.likelihoods, strict=False)}
    if nothing:
        return MatchEvidence(match="no_object", method=method, scores=scores, reason=nothing)
    best = ranked.likelihoods[0]
    if best < LEAST:
        return MatchEvidence(
            match="no_asset",
            method=method,
            confidence=round(1 - sum(ranked.likelihoods), 4),
            scores=scores,
            runner_up=ranked.names[0],
            reason=f"the likeliest asset, {ranked.names[0]}, is it with {100 * best:.0f} %: {ranked.reasons[0]}",
        )
    return MatchEvidence(
        match="asset",
        asset=ranked.names[0],
        method=method,
        confidence=round(best, 4),
        scores=scores,
        runner_up=ranked.names[1] if len(ranked.names) > 1 else None,
        reason=f"{100 * best:.0f} % likely: {ranked.reasons[0]}",
    )
