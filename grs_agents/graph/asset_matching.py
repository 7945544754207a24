"""Ask the configured match tool which asset stands for each candidate (paper, Scene Comprehension, step 3)."""

from collections.abc import Mapping, Sequence

from grs_agents.agents import roles
from grs_agents.agents.agent import Agents
from grs_agents.agents.types import Description, NoReply
from grs_agents.graph.describing import describe_measurements_for_model
from grs_agents.graph.services import Services
from grs_agents.graph.state import RunState
from grs_agents.perception.annotated_pictures import outlined_segment_file_name
from grs_agents.perception.configuration import DEFAULT
from grs_agents.perception.matching.types import Ask, MatchResult, Segment
from grs_agents.perception.picture_files import load_mask
from grs_agents.perception.types import CandidateRecord, MatchEvidence, Shown, TableFrame


def run_match_tool(
    records: Sequence[CandidateRecord], described: Mapping[int, Description], state: RunState, services: Services
) -> MatchResult:
    """What stands for each candidate; one that its describer calls no object is not asked about."""
    config = services.config
    asked = [record for record in records if described[record.id].is_object]
    segments = [
        Segment(
            record.id,
            load_mask(services.folder / record.mask),
            record.upright,
            services.folder / record.crop,
            record.points,
        )
        for record in asked
    ]
    silent: list[str] = []
    result: MatchResult = services.run_tool(
        config.tools.match,
        segments=segments,
        frame=services.load_photo(state),
        table=TableFrame.model_validate(state["table"]),
        ask=make_model_matcher(services.agents, asked, described, state["image"], silent),
        seed=config.seed,
        model=config.match.model,
        ocr=config.match.ocr,
        index=config.match.index,
    )
    matches = {number: drop_asset_below_confidence(answer) for number, answer in result.matches.items()}
    return MatchResult(matches, (*result.notes, *silent))


def drop_asset_below_confidence(answer: MatchEvidence) -> MatchEvidence:
    """The answer; ``no_asset`` where the asset it names is too likely the wrong one."""
    sure, least = answer.confidence, DEFAULT.matching.least
    if answer.match != "asset" or sure is None or sure >= least:
        return answer
    reason = f"{answer.asset} is less certain than {100 * least:.0f} %: {answer.reason}"
    update = {"match": "no_asset", "asset": None, "confidence": round(1 - sure, 4), "runner_up": answer.asset}
    return answer.model_copy(update={**update, "reason": reason})


def make_model_matcher(
    agents: Agents,
    records: Sequence[CandidateRecord],
    described: Mapping[int, Description],
    image: str,
    silent: list[str],
) -> Ask:
    """What asks the model of the role ``match``."""
    by_number = {candidate.id: candidate for candidate in records}

    def ask(segment: Segment, assets: Sequence[Shown], worded: bool, pictured: bool) -> MatchEvidence:
        record = by_number[segment.id]
        words = described[segment.id].model_dump(exclude={"is_object", "part_of"}, exclude_none=True) if worded else {}
        shown = [{**asset.model_dump(), "size": [round(value, 3) for value in asset.size]} for asset in assets]
        pictures = [record.crop, outlined_segment_file_name(record.id)] if pictured and image else []
        reply = roles.match_asset(agents, {**describe_measurements_for_model(record), **words}, shown, pictures)
        if isinstance(reply, NoReply):
            silent.append(f"candidate {segment.id}: {reply}; no asset was matched")
            return MatchEvidence(match="no_asset", reason=str(reply))
        asset = reply.asset if reply.match == "asset" else None
        kind = "no_asset" if reply.match == "asset" and asset is None else reply.match
        return MatchEvidence(match=kind, asset=asset, reason=reply.reason)

    return ask
