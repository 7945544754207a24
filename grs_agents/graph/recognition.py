"""Describe the segments of a photo, join pieces of the same object, and match them with assets."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypedDict

import numpy as np
from langchain_core.runnables.config import ContextThreadPoolExecutor

from grs_agents.agents import roles
from grs_agents.agents.agent import Agents
from grs_agents.agents.types import Description, NoReply
from grs_agents.base import interrupts
from grs_agents.graph.services import Photo, Services
from grs_agents.graph.state import TableObject
from grs_agents.models.factory import is_offline
from grs_agents.perception.annotated_pictures import (
    outlined_segment_file_name,
    segment_sheet_file_names,
    write_outlines,
    write_segment_sheet,
)
from grs_agents.perception.configuration import DEFAULT
from grs_agents.perception.matching.types import Ask, MatchResult, Segment
from grs_agents.perception.picture_files import load_candidates, load_mask, save_candidates_after_earlier
from grs_agents.perception.segmentation.described_pieces import (
    ADJOINING,
    gap_between_boxes,
    group_pieces_of_one_object,
    merge_pieces,
)
from grs_agents.perception.segmentation.regrouping import PixelBox, Regrouping, regroup_segments, scale_box
from grs_agents.perception.types import Candidate, CandidateRecord, DroppedCandidate, MatchEvidence, Shown

ONE_SEGMENT = """\
1. The segment, cut out; what is around it is dimmed and is no part of it.
2. The whole photo; the segment is outlined in magenta, all segments are outlined in white and numbered. Its edges have
   a ruler in pixels."""
MANY_SEGMENTS = """\
1. Each segment with its number, cut out; what is around it is dimmed and is no part of it.
2. The whole photo; the segments are outlined in white and numbered. Its edges have a ruler in pixels."""
NO_PICTURES = "There is none: go by the measurements, and say no more than they do."


@dataclass(frozen=True)
class DescribedSegments:
    """The described segments of a pass after pieces are joined."""

    objects: tuple[TableObject, ...]
    descriptions: dict[int, Description]  # of all segments, pieces included, by number
    dropped: tuple[DroppedCandidate, ...]  # the pieces
    notes: tuple[str, ...]  # for a reader of the scene


class DescriberQuestion(TypedDict):
    """The question of a call of the describer."""

    rows: list[dict[str, Any]]  # the measurements of the segments in question
    numbers: list[int]  # of all segments
    images: list[str]


def describe_measurements_for_model(record: CandidateRecord) -> dict[str, Any]:
    """The measurements of a segment in a prompt, beside its picture."""
    return {
        "id": record.id,
        "size_m": [round(value, 3) for value in record.upright.size],
        "position_m": [round(value, 3) for value in record.upright.center],
        "mean_color_rgb": [round(value, 2) for value in record.color],
        "outline": record.shape,
        "open_top": record.hollow,
        "pixels": record.points,
    }


def list_adjoining(record: CandidateRecord, records: Sequence[CandidateRecord]) -> list[int]:
    """The numbers of the segments that adjoin one of ``records``."""
    return [
        item.id for item in records if item.id != record.id and gap_between_boxes(record.box, item.box) <= ADJOINING
    ]


def make_describer_question(asked: Sequence[CandidateRecord], records: Sequence[CandidateRecord]) -> DescriberQuestion:
    """The question about some of the segments ``records``, with the pictures of `write_outlines` or a sheet."""
    rows: list[dict[str, Any]] = []
    for record in asked:
        row = {**describe_measurements_for_model(record), "near": list_adjoining(record, records)}
        rows.append({**row, "label": record.label} if record.label else row)
    first = asked[0]
    images = (
        [first.crop, outlined_segment_file_name(first.id)]
        if len(asked) == 1
        else list(segment_sheet_file_names(first.id))
    )
    return {"rows": rows, "numbers": [record.id for record in records], "images": images}


def ask_describer(agents: Agents, question: DescriberQuestion) -> dict[int, Description] | NoReply:
    """The description of each segment in question, by number."""
    pictures = ONE_SEGMENT if len(question["rows"]) == 1 else MANY_SEGMENTS
    pictures = pictures if question["images"] else NO_PICTURES
    return roles.describe_segments(agents, question["rows"], question["numbers"], pictures, question["images"])


def make_placeholder_description(shape: str) -> Description:
    """The description of a segment without a reply: its outline is a box or a cylinder."""
    words = f"an undescribed {shape}"
    return Description(is_object=True, description=words, color="unknown", shape=shape, category="object")


def describe_segments(
    records: Sequence[TableObject], first_free: int, photo: Photo, services: Services
) -> DescribedSegments:
    """Describe segments; joined pieces are numbered from ``first_free`` and described once more.

    Without a usable reply a description holds the measured outline alone.
    """
    spec, agents = services.config.model_for_role("describe"), services.agents
    sees = agents.sees_pictures("describe")
    threads = 1 if is_offline(spec.model) else spec.concurrency  # the embedded model gains nothing by threads
    in_one_sheet = services.config.match.describe == "sheet"

    def ask(question: DescriberQuestion) -> dict[int, Description] | NoReply:
        if interrupts.is_interrupt_requested():  # questions that still wait for a thread are not asked
            raise KeyboardInterrupt
        return ask_describer(agents, question)

    descriptions: dict[int, Description] = {}
    scale, parts = 1.0, set[int]()
    silent: dict[int, str] = {}  # reasons for missing descriptions, by number
    dropped: list[DroppedCandidate] = []
    notes: list[str] = []
    present, asked = list(records), list(records)
    with ContextThreadPoolExecutor(threads) as pool:
        while asked:
            if sees:
                scale = write_outlines(photo[0], asked, present, services.folder)
                if in_one_sheet and len(asked) > 1:
                    write_segment_sheet(photo[0], asked, present, services.folder)
            groups = [asked] if in_one_sheet else [[record] for record in asked]
            questions = [make_describer_question(group, present) for group in groups]
            if not sees:
                questions = [{**question, "images": []} for question in questions]
            for group, reply in zip(groups, pool.map(ask, questions), strict=True):
                if isinstance(reply, NoReply):
                    silent |= {record.id: str(reply) for record in group}
                    descriptions |= {record.id: make_placeholder_description(record.shape) for record in group}
                else:
                    descriptions |= reply
            several = {
                record.id: [scale_box(box, 1 / scale) for box in boxes]
                for record in asked
                if record.id not in parts
                and descriptions[record.id].shows == "several"
                and (boxes := descriptions[record.id].boxes)
            }
            asked, pieces, remarks = _join_described_pieces(
                asked, present, descriptions, first_free, photo, services.folder
            )
            gone = {piece.id for piece in pieces}
            present = [*(record for record in present if record.id not in gone), *asked]
            divided, wholes, doubts = _divide_described_segments(several, present, first_free, photo, services.folder)
            gone = {whole.id for whole in wholes}
            present = [*(record for record in present if record.id not in gone), *divided]
            asked += divided
            parts |= {record.id for record in divided}  # each is divided once
            dropped += [*pieces, *wholes]
            notes += [*remarks, *doubts]
    objects: list[TableObject] = []
    for item in present:
        words = descriptions[item.id]  # they overrule the depth camera, which does not see into every opening
        hollow = item.hollow if words.open_top is None else words.open_top
        objects.append(item.model_copy(update={"description": words, "hollow": hollow}))
    return DescribedSegments(
        objects=tuple(objects),
        descriptions=dict(sorted(descriptions.items())),
        dropped=tuple(dropped),
        notes=(
            *(f"candidate {number}: {reason}" for number, reason in sorted(silent.items())),
            *notes,
            *(
                f"candidate {item.id} shows several things, by its description: it stays one object"
                for item in objects
                if item.described.shows == "several"
            ),
        ),
    )


def _join_described_pieces(
    asked: Sequence[TableObject],
    present: Sequence[TableObject],
    descriptions: Mapping[int, Description],
    first_free: int,
    photo: Photo,
    folder: Path,
) -> tuple[list[TableObject], list[DroppedCandidate], list[str]]:
    """Join segments that were described as pieces of the same object, with numbers from ``first_free``.

    Returns:
        The joined objects, their pieces, and notes for a reader of the scene.
    """
    records = {record.id: record for record in present}
    part_of = {
        record.id: whole
        for record in asked
        if not record.given and (whole := descriptions[record.id].part_of) is not None
    }
    groups = group_pieces_of_one_object(part_of, {number: record.box for number, record in records.items()})
    free = max(first_free - 1, *records) + 1
    masks = {number: load_mask(folder / record.mask) for number, record in records.items() if groups}
    joined: list[Candidate] = []
    pieces: list[DroppedCandidate] = []
    notes = [
        f"segment {number} was described as a part of {whole}, which it does not adjoin: it stays by itself"
        for number, whole in part_of.items()
        if not any(number in group and whole in group for group in groups)
    ]
    for group in groups:
        whole = merge_pieces(free + len(joined), group, masks, *photo)
        if whole is None:
            numbers = ", ".join(map(str, group))
            notes.append(f"segments {numbers} are too large for one object: they stay apart")
            continue
        joined.append(whole)
        reason = f"a piece of a larger thing, candidate {whole.id}"
        pieces += [DroppedCandidate(id=piece, reason=f"{reason}: {descriptions[piece].description}") for piece in group]
    gone = {piece.id for piece in pieces}
    rest = [record for record in present if record.id not in gone]
    saved = save_candidates_after_earlier(photo[0], joined, rest, folder) if joined else ()
    return [TableObject.from_record(record) for record in saved], pieces, notes


def _divide_described_segments(
    several: Mapping[int, Sequence[PixelBox]],
    present: Sequence[TableObject],
    first_free: int,
    photo: Photo,
    folder: Path,
) -> tuple[list[TableObject], list[DroppedCandidate], list[str]]:
    """Divide segments that were described as several things, by the boxes of the things.

    Returns:
        The parts, the divided segments, and notes for a reader of the scene.
    """
    before = {record.id: record for record in present}
    divided = [(number, boxes) for number, boxes in several.items() if number in before]
    if not divided:
        return [], [], []
    nothing = np.zeros(photo[0].depth.shape, np.bool_)
    regrouped = regroup_segments(
        *photo, load_candidates(present, folder), nothing, Regrouping(divided=divided), first_free
    )
    new = [candidate for candidate in regrouped.candidates if candidate.id not in before]
    gone = {whole.id for whole in regrouped.dropped}
    rest = [record for record in present if record.id not in gone]
    saved = save_candidates_after_earlier(photo[0], new, rest, folder) if new else ()
    return [TableObject.from_record(record) for record in saved], [*regrouped.dropped], [*regrouped.notes]


def match_objects(
    objects: Sequence[TableObject], photo: Photo, image: str, services: Services
) -> tuple[list[TableObject], tuple[str, ...]]:
    """Ask the configured match tool for the asset of each described object (paper, Scene Comprehension, step 3).

    Segments described as no object are left out. An ``image`` gives the model pictures.

    Returns:
        The objects with their matches, and notes for a reader of the scene.
    """
    config = services.config
    asked = [item for item in objects if item.described.is_object]
    folder, silent = services.folder, list[str]()
    result: MatchResult = services.run_tool(
        config.tools.match,
        segments=[
            Segment(item.id, load_mask(folder / item.mask), item.upright, folder / item.crop, item.points)
            for item in asked
        ],
        frame=photo[0],
        table=photo[1],
        ask=make_model_matcher(services.agents, asked, {item.id: item.described for item in asked}, image, silent),
        seed=config.seed,
        model=config.match.model,
        ocr=config.match.ocr,
        index=config.match.index,
    )
    matched = [
        item.model_copy(update={"match": drop_asset_below_confidence(result.matches[item.id])})
        if item.id in result.matches
        else item
        for item in objects
    ]
    return matched, (*result.notes, *silent)


def drop_asset_below_confidence(answer: MatchEvidence) -> MatchEvidence:
    """The answer, or ``no_asset`` if the confidence in its asset is too low."""
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
    """A function that asks the model of the role ``match``; segments without a usable reply are noted in ``silent``."""
    by_number = {record.id: record for record in records}

    def ask(segment: Segment, assets: Sequence[Shown], worded: bool, pictured: bool) -> MatchEvidence:
        record = by_number[segment.id]
        words = (
            described[segment.id].model_dump(exclude={"is_object", "part_of", "shows", "boxes"}, exclude_none=True)
            if worded
            else {}
        )
        shown = [{**dict(asset), "size": [round(value, 3) for value in asset.size]} for asset in assets]
        pictures = [record.crop, outlined_segment_file_name(record.id)] if pictured and image else []
        reply = roles.match_asset(agents, {**describe_measurements_for_model(record), **words}, shown, pictures)
        if isinstance(reply, NoReply):
            silent.append(f"candidate {segment.id}: {reply}; no asset was matched")
            return MatchEvidence(match="no_asset", reason=str(reply))
        asset = reply.asset if reply.match == "asset" else None
        kind = "no_asset" if reply.match == "asset" and asset is None else reply.match
        return MatchEvidence(match=kind, asset=asset, reason=reply.reason)

    return ask
