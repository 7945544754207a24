"""Ask the configured match tool which asset stands for each candidate (paper, Scene Comprehension, step 3)."""

from collections.abc import Mapping, Sequence

from grs_agents.agents import Description, NoReply, roles
from grs_agents.correspondence.types import MatchResult, Segment
from grs_agents.nodes.services import Services
from grs_agents.scene import Camera, CandidateRecord, MatchEvidence, Shown, TableFrame, load_frame, load_mask
from grs_agents.state import RunState


def correspond(
    records: Sequence[CandidateRecord],
    described: Mapping[int, Description],
    measured: Mapping[int, dict[str, object]],
    state: RunState,
    services: Services,
) -> MatchResult:
    """What stands for each candidate; one that its describer calls no object is not asked about.

    Args:
        records: the candidates.
        described: what was said of each.
        measured: what a model is told of each besides.
        state, services: of the run.

    Raises:
        GrsError: the tool cannot be used, or a model cannot be reached.
    """
    config = services.config
    asked = [record for record in records if described[record.id].is_object]
    frame = load_frame(services.folder, Camera.model_validate(state["camera"]), state["scene_path"])
    segments = [
        Segment(one.id, load_mask(services.folder / one.mask), one.upright, services.folder / one.crop, one.points)
        for one in asked
    ]
    crops = {one.id: one.crop for one in asked}
    silent: list[str] = []

    def ask(segment: Segment, assets: Sequence[Shown], worded: bool, pictured: bool) -> MatchEvidence:
        words = described[segment.id].model_dump(exclude={"is_object"}) if worded else {}
        shown = [{**asset.model_dump(), "size": [round(value, 3) for value in asset.size]} for asset in assets]
        pictures = [crops[segment.id], state["image"]] if pictured and state["image"] else []
        reply = roles.match(services.agents, {**measured[segment.id], **words}, shown, pictures)
        if isinstance(reply, NoReply):
            silent.append(f"candidate {segment.id}: {reply}; no asset was matched")
            return MatchEvidence(match="no_asset", reason=str(reply))
        return MatchEvidence(match=reply.match, asset=reply.asset, reason=reply.reason)

    table = TableFrame.model_validate(state["frame"])
    told = config.match
    result: MatchResult = services.tool(
        config.tools.match, segments=segments, frame=frame, table=table, ask=ask, seed=config.seed,
        model=told.model, ocr=told.ocr, index=told.index,
    )  # fmt: skip
    return MatchResult(result.matches, (*result.notes, *silent))
