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
    group_segments_for_sheets,
    outlined_segment_file_name,
    write_numbered_photo,
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
from grs_agents.perception.types import (
    Candidate,
    CandidateRecord,
    DroppedCandidate,
    MatchEvidence,
    RGBDFrame,
    Shown,
)

ONE_SEGMENT = """\
1. The segment, cut out; what is around it is dimmed and is no part of it.
2. The whole photo; the segment is outlined in magenta, all segments are outlined in white and numbered. Its edges have
   a ruler in pixels."""
MANY_SEGMENTS = """\
1. Each segment with its number, cut out; what is around it is dimmed and is no part of it.
2. The whole photo; the segments are outlined in white and numbered. Its edges have a ruler in pixels."""
NO_PICTURES = "There is none: go by the measurements, and say no more than they do."
SHEETS = """\
1. Sheets with each segment and its number, cut out; what is around it is dimmed and is no part of it.
2. The last picture: the whole photo; the segments are outlined in white and numbered."""
_COMPARED = {"description", "color", "shape", "category"}
"""The fields of a description that a match compares."""


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


def make_describer_question(
    asked: Sequence[CandidateRecord], records: Sequence[CandidateRecord], images: Sequence[str]
) -> DescriberQuestion:
    """The question about some of the segments ``records``, with the picture files ``images``."""
    rows: list[dict[str, Any]] = []
    for record in asked:
        row = {**describe_measurements_for_model(record), "near": list_adjoining(record, records)}
        rows.append({**row, "label": record.label} if record.label else row)
    return {"rows": rows, "numbers": [record.id for record in records], "images": [*images]}


def ask_describer(agents: Agents, question: DescriberQuestion) -> dict[int, Description] | NoReply:
    """The description of each segment in question, by number."""
    pictures = ONE_SEGMENT if len(question["rows"]) == 1 else MANY_SEGMENTS
    pictures = pictures if question["images"] else NO_PICTURES
    return roles.describe_segments(agents, question["rows"], question["numbers"], pictures, question["images"])


def write_question_pictures(
    groups: Sequence[Sequence[CandidateRecord]], records: Sequence[CandidateRecord], photo: Photo, folder: Path
) -> tuple[list[list[str]], float]:
    """Write the pictures for a question about each group of the segments ``records``: crops, and the whole photo.

    Returns:
        The files of each question, and the pixels of the shown photo per pixel of the photo.
    """
    single, scale = [group[0] for group in groups if len(group) == 1], 1.0
    if single:
        scale = write_outlines(photo[0], single, records, folder)
    sheets = [group for group in groups if len(group) > 1]
    numbered = f"scene/numbered_{sheets[0][0].id:02d}.png" if sheets else ""
    if sheets:
        scale = write_numbered_photo(photo[0], records, folder, numbered)
    files = [
        [write_segment_sheet(group, folder), numbered]
        if len(group) > 1
        else [group[0].crop, outlined_segment_file_name(group[0].id)]
        for group in groups
    ]
    return files, scale


def make_placeholder_description(shape: str) -> Description:
    """The description of a segment without a reply: its outline is a box or a cylinder."""
    words = f"an undescribed {shape}"
    return Description(is_object=True, description=words, color="unknown", shape=shape, category="object")


def describe_segments(
    records: Sequence[TableObject], first_free: int, photo: Photo, services: Services
) -> DescribedSegments:
    """Describe segments; joined pieces are numbered from ``first_free`` and described once more.

    A model that sees is shown several segments on a sheet, and each by itself where its reply about the sheet cannot be
    used. Without a usable reply a description holds the measured outline alone.
    """
    spec, agents, folder = services.config.model_for_role("describe"), services.agents, services.folder
    sees = agents.sees_pictures("describe")
    on_sheets = sees and services.config.match.describe == "sheet"
    descriptions: dict[int, Description] = {}
    scale, parts = 1.0, set[int]()  # of the photo that the describer sees; parts of divided segments
    silent: dict[int, str] = {}  # reasons for missing descriptions, by number
    dropped: list[DroppedCandidate] = []
    notes: list[str] = []
    present, asked = list(records), list(records)

    def ask(question: DescriberQuestion) -> dict[int, Description] | NoReply:
        if interrupts.is_interrupt_requested():  # questions that still wait for a thread are not asked
            raise KeyboardInterrupt
        return ask_describer(agents, question)

    def ask_about(groups: Sequence[Sequence[TableObject]]) -> dict[int, str]:
        """Ask about each group; returns the reasons for missing descriptions, by number."""
        nonlocal scale
        pictures: list[list[str]] = [[] for _ in groups]
        if sees:
            pictures, scale = write_question_pictures(groups, present, photo, folder)
        questions = [
            make_describer_question(group, present, images) for group, images in zip(groups, pictures, strict=True)
        ]
        missing: dict[int, str] = {}
        for group, reply in zip(groups, pool.map(ask, questions), strict=True):
            if isinstance(reply, NoReply):
                missing |= {record.id: str(reply) for record in group}
            else:
                descriptions.update(reply)
        return missing

    # The offline model gains nothing by threads
    with ContextThreadPoolExecutor(1 if is_offline(spec.model) else spec.concurrency) as pool:
        while asked:
            groups = group_segments_for_sheets(asked, folder) if on_sheets else [[record] for record in asked]
            missing = ask_about(groups)
            if missing and len(groups) < len(asked):  # a sheet may ask too much of a small model
                missing = ask_about([[record] for record in asked if record.id in missing])
            silent |= missing
            for record in asked:
                if record.id in missing:
                    descriptions[record.id] = make_placeholder_description(record.shape)
            several = {
                record.id: [scale_box(box, 1 / scale) for box in boxes]
                for record in asked
                if record.id not in parts
                and descriptions[record.id].shows == "several"
                and (boxes := descriptions[record.id].boxes)
            }
            asked, pieces, remarks = _join_described_pieces(asked, present, descriptions, first_free, photo, folder)
            gone = {piece.id for piece in pieces}
            present = [*(record for record in present if record.id not in gone), *asked]
            divided, wholes, doubts = _divide_described_segments(several, present, first_free, photo, folder)
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
    config, agents, folder = services.config, services.agents, services.folder
    asked = [item for item in objects if item.described.is_object]
    described, silent = {item.id: item.described for item in asked}, list[str]()

    matcher = make_model_matcher(agents, asked, described, photo[0] if image else None, silent)
    result: MatchResult = services.run_tool(
        config.tools.match,
        segments=[
            Segment(item.id, load_mask(folder / item.mask), item.upright, folder / item.crop, item.points)
            for item in asked
        ],
        frame=photo[0],
        table=photo[1],
        ask=matcher if agents.sees_pictures("match") else None,
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
    frame: RGBDFrame | None,
    silent: list[str],
) -> Ask:
    """A function that asks the model of the role ``match`` once about several segments.

    Args:
        agents: the chat models.
        records: the segments that it may be asked about.
        described: their descriptions by number; empty for a question without words.
        frame: the photo; None for a question without pictures.
        silent: takes a note if there is no usable reply.
    """
    by_number = {record.id: record for record in records}

    def ask(segments: Sequence[Segment], assets: Sequence[Shown]) -> dict[int, MatchEvidence]:
        asked = [by_number[segment.id] for segment in segments]
        rows = [
            {
                "id": record.id,
                "size_m": [round(value, 3) for value in record.upright.size],
                "pixels": record.points,
                **(described[record.id].model_dump(include=_COMPARED) if record.id in described else {}),
            }
            for record in asked
        ]
        shown = [{**dict(asset), "size": [round(value, 3) for value in asset.size]} for asset in assets]
        images: list[str] = []
        if frame is not None:
            groups = group_segments_for_sheets(asked, agents.folder)
            numbered = f"scene/matched_numbered_{asked[0].id:02d}.png"
            write_numbered_photo(frame, asked, agents.folder, numbered)
            images = [*(write_segment_sheet(group, agents.folder, "matched") for group in groups), numbered]
        pictures = SHEETS if images else "(none)"
        reply = roles.match_segments(agents, rows, shown, pictures, images)
        if isinstance(reply, NoReply):
            silent.append(f"{reply}: assets are matched by measured features")
            return {}
        return {
            number: MatchEvidence(
                match=match.match, asset=match.asset, confidence=match.confidence, reason=match.reason
            )
            for number, match in reply.items()
        }

    return ask
