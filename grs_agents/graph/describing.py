"""Describe the segments of a photo, all at once, and put together those that are pieces of one thing.

The describer is asked by a graph within the node: LangGraph sends it each question on its own, and hands the answers on
in the order of the questions, in whatever order they came.
"""

import operator
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated, Any, TypedDict

from langgraph.graph import END, START, StateGraph
from langgraph.types import Send

from grs_agents.agents import roles
from grs_agents.agents.agent import Agents
from grs_agents.agents.types import Description, NoReply
from grs_agents.base import interrupts
from grs_agents.graph.services import Photo, Services
from grs_agents.models.factory import is_offline
from grs_agents.perception.annotated_pictures import (
    outlined_segment_file_name,
    segment_sheet_file_names,
    write_outlines,
    write_segment_sheet,
)
from grs_agents.perception.picture_files import load_mask, save_candidates_after_earlier
from grs_agents.perception.segmentation.described_pieces import (
    ADJOINING,
    gap_between_boxes,
    group_pieces_of_one_object,
    merge_pieces,
)
from grs_agents.perception.types import Candidate, CandidateRecord, DroppedCandidate

ONE_SEGMENT = """\
1. The segment, cut out; what is around it is dimmed and is no part of it.
2. The whole photo; the segment is outlined in magenta, all segments are outlined in white and numbered."""
MANY_SEGMENTS = """\
1. Each segment with its number, cut out; what is around it is dimmed and is no part of it.
2. The whole photo; the segments are outlined in white and numbered."""

Group = tuple[int, ...]
"""The numbers of segments that are pieces of one thing."""


@dataclass(frozen=True)
class DescribedSegments:
    """The segments of a pass once pieces are put together, and what the describer said of them and of the pieces."""

    records: tuple[CandidateRecord, ...]
    descriptions: dict[int, Description]
    dropped: tuple[DroppedCandidate, ...]  # the pieces
    notes: tuple[str, ...]  # what a reader of the scene should know


class DescriberQuestion(TypedDict):
    """What the describer is asked in one call."""

    rows: list[dict[str, Any]]  # the segments that are asked about, as the prompt tells them
    numbers: list[int]  # of all segments
    images: list[str]


class _State(TypedDict):
    """Of the graph within the node: JSON, since it is checkpointed."""

    records: list[dict[str, Any]]  # the segments
    asked: list[int]  # those that are described next
    descriptions: Annotated[dict[str, dict[str, Any]], operator.or_]
    silent: Annotated[dict[str, str], operator.or_]  # why there is no description, by number
    dropped: Annotated[list[dict[str, Any]], operator.add]
    notes: Annotated[list[str], operator.add]


def describe_measurements_for_model(record: CandidateRecord) -> dict[str, Any]:
    """What a model is told of a candidate besides its picture."""
    return {
        "id": record.id,
        "size_m": [round(value, 3) for value in record.upright.size],
        "position_m": [round(value, 3) for value in record.upright.center],
        "mean_color_rgb": [round(value, 2) for value in record.color],
        "outline": record.shape,
        "open_top": record.hollow,
        "pixels": record.points,
    }


def make_describer_question(asked: Sequence[CandidateRecord], records: Sequence[CandidateRecord]) -> DescriberQuestion:
    """The question about some of the segments ``records``; its pictures are those of `write_outlines`, or a sheet."""
    rows = [
        {
            **describe_measurements_for_model(one),
            "near": [other.id for other in records if _are_boxes_adjoining(one, other)],
        }
        for one in asked
    ]
    first = asked[0]
    images = (
        [first.crop, outlined_segment_file_name(first.id)]
        if len(asked) == 1
        else list(segment_sheet_file_names(first.id))
    )
    return {"rows": rows, "numbers": [one.id for one in records], "images": images}


def _are_boxes_adjoining(one: CandidateRecord, other: CandidateRecord) -> bool:
    return one.id != other.id and gap_between_boxes(one.box, other.box) <= ADJOINING


def ask_describer(agents: Agents, question: DescriberQuestion) -> dict[int, Description] | NoReply:
    """What the describer says of each segment that it is asked about, by number."""
    pictures = ONE_SEGMENT if len(question["rows"]) == 1 else MANY_SEGMENTS
    return roles.describe_segments(agents, question["rows"], question["numbers"], pictures, question["images"])


def make_placeholder_description(shape: str) -> Description:
    """What is known of a segment that nobody described: that its outline is a box or a cylinder."""
    words = f"an undescribed {shape}"
    return Description(is_object=True, description=words, color="unknown", shape=shape, category="object")


def describe_segments(
    records: Sequence[CandidateRecord], first_free: int, photo: Photo, services: Services
) -> DescribedSegments:
    """Describe segments; what is put together of them is numbered from ``first_free`` and described once more."""
    describer = _Describer(photo, services, first_free)
    describer.write_question_pictures(records, records)
    graph = StateGraph(_State)
    graph.add_node("ask", describer.ask)
    graph.add_node("merge", describer.merge)
    graph.add_conditional_edges(START, describer.send_next_questions, ["ask"])
    graph.add_edge("ask", "merge")
    graph.add_conditional_edges("merge", describer.send_next_questions, ["ask", END])
    begin: Any = {"records": [one.model_dump(mode="json") for one in records], "asked": [one.id for one in records]}
    spec = services.config.model_for_role("describe")
    at_once = 1 if is_offline(spec.model) else spec.concurrency  # which asks nobody gains nothing by it
    end = graph.compile().invoke(begin, {"max_concurrency": at_once, "recursion_limit": 2 * len(records) + 5})
    said = {int(number): Description.model_validate(one) for number, one in end["descriptions"].items()}
    silent = [f"candidate {number}: {end['silent'][str(number)]}" for number in sorted(map(int, end["silent"]))]
    kept = [CandidateRecord.model_validate(one) for one in end["records"]]
    return DescribedSegments(
        records=tuple(_update_open_top_from_description(one, said[one.id]) for one in kept),
        descriptions=dict(sorted(said.items())),
        dropped=tuple(DroppedCandidate.model_validate(one) for one in end["dropped"]),
        notes=(*silent, *end["notes"]),
    )


def _update_open_top_from_description(record: CandidateRecord, said: Description) -> CandidateRecord:
    """Open at the top if it was described so: the depth camera does not see into everything."""
    return record if said.open_top is None else record.model_copy(update={"hollow": said.open_top})


@dataclass(frozen=True)
class _Describer:
    """The nodes of the graph within the node."""

    photo: Photo
    services: Services
    first_free: int

    @property
    def describes_all_in_one_sheet(self) -> bool:
        return self.services.config.match.describe == "sheet"

    @property
    def describer_sees_pictures(self) -> bool:
        """Whether the describer looks at pictures: the embedded model reads the measurements alone."""
        return not is_offline(self.services.config.model_for_role("describe").model)

    def write_question_pictures(self, asked: Sequence[CandidateRecord], records: Sequence[CandidateRecord]) -> None:
        """For the questions about some of the segments; for the same segments always the same."""
        if not self.describer_sees_pictures:
            return
        write_outlines(self.photo[0], asked, records, self.services.folder)
        if self.describes_all_in_one_sheet and len(asked) > 1:
            write_segment_sheet(self.photo[0], asked, records, self.services.folder)

    def send_next_questions(self, state: _State) -> list[Send] | str:
        """What is to be asked next: one question for each segment, or one for all."""
        records = [CandidateRecord.model_validate(one) for one in state["records"]]
        asked = [one for one in records if one.id in state["asked"]]
        groups = [asked] if self.describes_all_in_one_sheet and asked else [[one] for one in asked]
        questions = [make_describer_question(group, records) for group in groups]
        if not self.describer_sees_pictures:
            questions = [{**question, "images": []} for question in questions]
        return [Send("ask", question) for question in questions] or END

    def ask(self, state: DescriberQuestion) -> dict[str, Any]:
        """What the describer says; without a usable reply, what was measured and nothing else."""
        if interrupts.is_interrupt_requested():  # those that were waiting for their turn are not asked any more
            raise KeyboardInterrupt
        reply = ask_describer(self.services.agents, state)
        if isinstance(reply, NoReply):
            numbers = [int(row["id"]) for row in state["rows"]]
            silent = dict.fromkeys(map(str, numbers), str(reply))
            measured = {int(row["id"]): make_placeholder_description(str(row["outline"])) for row in state["rows"]}
            return {"descriptions": _descriptions_as_json(measured), "silent": silent}
        return {"descriptions": _descriptions_as_json(reply)}

    def merge(self, state: _State) -> dict[str, Any]:
        """Put together what was described as pieces of one thing; that is described next."""
        records = {int(one["id"]): CandidateRecord.model_validate(one) for one in state["records"]}
        said = {number: Description.model_validate(state["descriptions"][str(number)]) for number in records}
        part_of = _map_piece_ids_to_whole_ids([records[number] for number in state["asked"]], said)
        groups = group_pieces_of_one_object(part_of, {number: one.box for number, one in records.items()})
        merged, too_large = self.measure_merged_groups(groups, records)
        dropped = _list_pieces_as_dropped(merged, said)
        pieces = {piece.id for piece in dropped}
        rest = [one for number, one in records.items() if number not in pieces]
        added = self.save([whole for _, whole in merged], rest)
        return {
            "records": [one.model_dump(mode="json") for one in (*rest, *added)],
            "asked": [one.id for one in added],
            "dropped": [one.model_dump(mode="json") for one in dropped],
            "notes": [*_list_pieces_not_merged(part_of, groups), *too_large],
        }

    def save(self, merged: Sequence[Candidate], rest: Sequence[CandidateRecord]) -> tuple[CandidateRecord, ...]:
        """What was put together, beside the rest, with the pictures for the questions about it."""
        folder = self.services.folder
        added = save_candidates_after_earlier(self.photo[0], merged, rest, folder) if merged else ()
        self.write_question_pictures(added, [*rest, *added])
        return added

    def measure_merged_groups(
        self, groups: Sequence[Group], records: Mapping[int, CandidateRecord]
    ) -> tuple[list[tuple[Group, Candidate]], list[str]]:
        """Each group of segments with what it is together, measured; and which are too large for that."""
        free = max(self.first_free - 1, *records) + 1
        masks = {number: load_mask(self.services.folder / one.mask) for number, one in records.items() if groups}
        merged: list[tuple[Group, Candidate]] = []
        notes: list[str] = []
        for group in groups:
            whole = merge_pieces(free + len(merged), group, masks, *self.photo)
            if whole is not None:
                merged.append((group, whole))
            else:
                notes.append(f"segments {', '.join(map(str, group))} are too large for one object: they stay apart")
        return merged, notes


def _map_piece_ids_to_whole_ids(asked: Sequence[CandidateRecord], said: Mapping[int, Description]) -> dict[int, int]:
    """For each segment that was described as a piece what it is said to be a part of; what the user gave is none."""
    parts = {one.id: said[one.id].part_of for one in asked if not one.given}
    return {number: whole for number, whole in parts.items() if whole is not None}


def _list_pieces_as_dropped(
    merged: Sequence[tuple[Group, Candidate]], said: Mapping[int, Description]
) -> list[DroppedCandidate]:
    """The segments that are pieces, with what they are pieces of and what was said of them."""
    return [
        DroppedCandidate(id=one, reason=f"a piece of a larger thing, candidate {whole.id}: {said[one].description}")
        for group, whole in merged
        for one in group
    ]


def _list_pieces_not_merged(part_of: Mapping[int, int], groups: Sequence[Group]) -> list[str]:
    """Which pieces are not put together with what they were said to be a part of."""
    return [
        f"segment {number} was described as a part of {whole}, which it does not adjoin: it stays by itself"
        for number, whole in part_of.items()
        if not any(number in group and whole in group for group in groups)
    ]


def _descriptions_as_json(said: Mapping[int, Description]) -> dict[str, Any]:
    return {str(number): one.model_dump(mode="json") for number, one in said.items()}
