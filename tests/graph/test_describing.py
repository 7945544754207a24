"""All segments are described at once, in whatever order the answers come; pieces of one thing are put together."""

import json
import re
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from threading import Barrier
from types import SimpleNamespace
from typing import Any, cast

import cv2
import numpy as np
import pytest
from langchain_core.callbacks import CallbackManagerForLLMRun
from langchain_core.language_models.chat_models import BaseChatModel
from langchain_core.messages import BaseMessage
from langchain_core.outputs import ChatGeneration, ChatResult

from grs_agents.agents.agent import Agents
from grs_agents.base.config.schema import Config
from grs_agents.base.trace.events import Prompt
from grs_agents.base.trace.log import EventLog, read_events
from grs_agents.graph.recognition import NO_PICTURES, describe_segments
from grs_agents.graph.services import Photo, Services
from grs_agents.graph.state import TableObject
from grs_agents.perception.annotated_pictures import group_segments_for_sheets, write_segment_sheet
from grs_agents.perception.picture_files import load_mask, save_candidates, save_frame
from grs_agents.perception.segmentation.candidates import measure_candidates
from grs_agents.perception.types import Mask
from tests.perception.settling.photo import BLOCK, LIBRARY, MILK, photo_of, standing
from tests.scripted import say

Says = dict[int, dict[str, Any]]
STANDS, APART = standing(MILK, 0.55, 0.0), standing(BLOCK, 0.42, 0.15)


class Eyes(BaseChatModel):
    """Describes segments by their numbers, those of ``spoilt`` never as asked; ``meet`` is told of each question."""

    says: Says
    spoilt: tuple[int, ...] = ()
    meet: Callable[[list[int]], object] = lambda numbers: None

    @property
    def _llm_type(self) -> str:
        return "eyes"

    def _generate(
        self,
        messages: list[BaseMessage],
        stop: list[str] | None = None,
        run_manager: CallbackManagerForLLMRun | None = None,
        **kwargs: Any,
    ) -> ChatResult:
        numbers = [int(found) for found in re.findall(r'^{"id":(\d+)', str(messages[1].text), re.MULTILINE)]
        self.meet(numbers)
        plain = {"is_object": True, "color": "red", "shape": "box", "category": "thing"}
        rows = [{"id": one, "description": f"thing {one}", **plain, **self.says.get(one, {})} for one in numbers]
        text = "```json\n" + "\n".join(map(json.dumps, reversed(rows))) + "\n```"
        reply = say("I see." if {*numbers} & {*self.spoilt} else text)
        return ChatResult(generations=[ChatGeneration(message=reply)])


@dataclass
class SeeingAgents(Agents):
    """Agents of which every role has the same eyes."""

    eyes: Eyes = field(default_factory=lambda: Eyes(says={}))

    def chat_model_for_role(self, role: str) -> BaseChatModel:
        """The eyes."""
        return self.eyes


@dataclass(frozen=True)
class Table:
    """A carton in two pieces and a block apart from it, in a photo, as candidates 1, 2 and 3."""

    folder: Path
    photo: Photo
    records: tuple[TableObject, ...]

    def services(self, eyes: Eyes, pictures: bool = True, **match: Any) -> Services:
        """As much of the services as describing uses."""
        model = {"model": "openai:any", "pictures": pictures}
        config = Config.model_validate({"models": {"default": model}, "match": match})
        agents = SeeingAgents(config, EventLog(self.folder / "events.jsonl"), self.folder, eyes=eyes)
        return cast(Services, SimpleNamespace(config=config, agents=agents, folder=self.folder))

    def prompts(self) -> list[Prompt]:
        """What was asked."""
        return [event for event in read_events(self.folder / "events.jsonl") if isinstance(event, Prompt)]


@pytest.fixture
def table(tmp_path: Path) -> Table:
    frame, pose, mask = photo_of([STANDS, APART], LIBRARY)
    block = photo_of([APART], LIBRARY)[2] & mask
    rows = np.arange(mask.shape[0])[:, None]
    upper = mask & ~block & (rows < np.median(np.nonzero(mask & ~block)[0]))
    save_frame(frame, tmp_path)
    candidates = measure_candidates(frame, pose, mask.astype("int32") + upper + 2 * block)
    records = tuple(map(TableObject.from_record, save_candidates(frame, candidates, tmp_path)))
    return Table(tmp_path, (frame, pose), records)


def test_pieces_of_one_thing_become_one_candidate_that_is_measured_and_described_anew(table: Table) -> None:
    sliver = {"is_object": False, "description": "a sliver"}
    eyes = Eyes(says={1: {**sliver, "part_of": 2}, 2: {**sliver, "part_of": 1}, 4: {"open_top": True}})
    found = describe_segments(table.records, 4, table.photo, table.services(eyes))
    block, carton = found.objects
    assert (block.id, carton.id) == (3, 4)
    assert found.descriptions[4].description == "thing 4"
    assert carton.hollow and not block.hollow
    assert carton.description == found.descriptions[4]
    masks = [load_mask(table.folder / one.mask) for one in (carton, *table.records[:2])]
    assert np.array_equal(masks[0], masks[1] | masks[2])
    (whole,) = measure_candidates(*table.photo, masks[0].astype("int32"))
    assert carton.upright.size == pytest.approx(whole.upright.size, abs=0.002)
    assert carton.upright.size[2] == pytest.approx(LIBRARY.asset(MILK).size[2], abs=0.01)
    assert {piece.id: "candidate 4" in piece.reason and "a sliver" in piece.reason for piece in found.dropped} == {
        1: True,
        2: True,
    }
    assert not found.notes
    assert table.prompts()[-1].images == (carton.crop, "scene/marked_04.png")


@pytest.mark.parametrize("way", ["each", "sheet"])
def test_a_model_that_takes_no_pictures_is_told_of_none(table: Table, way: str) -> None:
    found = describe_segments(table.records, 4, table.photo, table.services(Eyes(says={}), False, describe=way))
    assert list(found.descriptions) == [1, 2, 3]
    assert all(not prompt.images for prompt in table.prompts())
    assert all(NO_PICTURES in prompt.text and "magenta" not in prompt.text for prompt in table.prompts())
    assert not list(table.folder.rglob("marked_*")) + list(table.folder.rglob("sheet_*"))


def test_all_segments_are_asked_at_once_and_answers_are_ordered_by_number(table: Table) -> None:
    together = Barrier(3, timeout=60)
    eyes = Eyes(says={}, spoilt=(2,), meet=_once_each(together))
    found = describe_segments(table.records, 4, table.photo, table.services(eyes, describe="each"))
    assert list(found.descriptions) == [1, 2, 3] == [one.id for one in found.objects]
    assert found.descriptions[2].description.startswith("an undescribed")
    assert [found.descriptions[one].description for one in (1, 3)] == ["thing 1", "thing 3"]
    (note,) = found.notes
    assert note.startswith("candidate 2: the describe model gave no usable reply")


def _once_each(together: Barrier) -> Callable[[list[int]], object]:
    met: set[int] = set()

    def meet(numbers: list[int]) -> None:
        if not met & {*numbers}:
            met.update(numbers)
            together.wait()

    return meet


def test_the_label_of_a_mask_is_given_to_the_describer(table: Table) -> None:
    first, *rest = table.records
    labelled = [first.model_copy(update={"label": "Coffee mug"}), *rest]
    describe_segments(labelled, 4, table.photo, table.services(Eyes(says={})))
    texts = [prompt.text for prompt in table.prompts()]
    assert sum('"label":"Coffee mug"' in text for text in texts) == 1
    assert sum('"label"' in text for text in texts) == 1
    agents = Agents(Config(), EventLog(table.folder / "offline.jsonl"), table.folder)
    services = cast(Services, SimpleNamespace(config=Config(), agents=agents, folder=table.folder))
    words = describe_segments(labelled, 4, table.photo, services).descriptions[1]
    assert words.category == "mug" and "coffee mug" in words.description


def test_what_does_not_adjoin_its_thing_stays_by_itself(table: Table) -> None:
    found = describe_segments(table.records, 4, table.photo, table.services(Eyes(says={3: {"part_of": 1}})))
    assert [one.id for one in found.objects] == [1, 2, 3]
    assert not found.dropped
    (note,) = found.notes
    assert "segment 3 was described as a part of 1" in note


def test_several_things_stay_an_object_with_a_note_and_a_robot_is_none(table: Table) -> None:
    eyes = Eyes(says={1: {"is_object": "several things"}, 3: {"is_object": "robot"}})
    found = describe_segments(table.records, 4, table.photo, table.services(eyes))
    assert [one.described.is_object for one in found.objects] == [True, True, False]
    assert found.notes == ("candidate 1 shows several things, by its description: it stays one object",)


@pytest.mark.parametrize("word", ["background", "nothing", "a cable", "Sliver", "furniture", "the cloth"])
def test_a_word_for_no_object_is_enough(table: Table, word: str) -> None:
    empty = dict.fromkeys(("description", "color", "shape", "category"))
    found = describe_segments(
        table.records, 4, table.photo, table.services(Eyes(says={3: {"is_object": word, **empty}}))
    )
    assert [one.described.is_object for one in found.objects] == [True, True, False] and not found.notes


def test_several_things_with_boxes_are_divided_and_each_is_described(table: Table) -> None:
    whole = {"is_object": False, "part_of": 1}
    boxes = [_box_of(load_mask(table.folder / record.mask)) for record in table.records[:2]]
    several = {"is_object": "several things", "boxes": boxes, "description": None, "color": None}
    eyes = Eyes(says={2: whole, 4: several, 5: {**several, "is_object": "two objects"}})
    found = describe_segments(table.records, 4, table.photo, table.services(eyes))
    assert [item.id for item in found.objects] == [3, 5, 6]  # 1 and 2 became 4, which became 5 and 6
    assert {item.id: item.reason.split(":")[0] for item in found.dropped} == {
        **dict.fromkeys((1, 2), "a piece of a larger thing, candidate 4"),
        4: "several objects",
    }
    masks = [load_mask(table.folder / record.mask) for record in (*table.records[:2], *found.objects[1:])]
    for before, after in zip(masks[:2], masks[2:], strict=True):
        assert np.count_nonzero(before & after) > 0.8 * np.count_nonzero(before | after)
    assert found.notes == ("candidate 5 shows several things, by its description: it stays one object",)
    assert found.descriptions[6].description == "thing 6"


def test_several_things_in_boxes_beside_the_segment_stay_an_object(table: Table) -> None:
    eyes = Eyes(says={3: {"is_object": "several things", "boxes": [[0, 0, 4, 4], [6, 0, 4, 4]]}})
    found = describe_segments(table.records, 4, table.photo, table.services(eyes))
    assert [item.id for item in found.objects] == [1, 2, 3]
    assert "segment 3 is not divided" in found.notes[0] and "it stays one object" in found.notes[1]


def test_a_box_of_a_single_thing_divides_nothing(table: Table) -> None:
    eyes = Eyes(says={3: {"boxes": [[0, 0, 4, 4]]}})
    found = describe_segments(table.records, 4, table.photo, table.services(eyes))
    assert [item.id for item in found.objects] == [1, 2, 3] and not found.notes


def _box_of(mask: Mask) -> list[int]:
    """Left, top, width and height of a mask in the photo, which is shown as large as it is."""
    rows, columns = np.nonzero(mask)
    x, y = int(columns.min()), int(rows.min())
    return [x, y, int(columns.max()) + 1 - x, int(rows.max()) + 1 - y]


def test_a_number_that_is_no_segment_is_asked_about_again(table: Table) -> None:
    says = {number: {"part_of": 40 + number} for number in (1, 2, 3)}
    found = describe_segments(table.records, 4, table.photo, table.services(Eyes(says=says)))
    assert len(found.notes) == 3 and all("part_of" in note for note in found.notes)


def test_a_sheet_asks_about_all_segments_in_one_call(table: Table) -> None:
    asked: list[list[int]] = []
    eyes = Eyes(says={}, meet=asked.append)
    found = describe_segments(table.records, 4, table.photo, table.services(eyes))
    assert asked == [[1, 2, 3]]
    assert [one.description for one in found.descriptions.values()] == ["thing 1", "thing 2", "thing 3"]
    (prompt,) = table.prompts()
    sheet, numbered = (cv2.imread(str(table.folder / name)) for name in prompt.images)
    assert sheet is not None and numbered is not None
    assert numbered.shape == table.photo[0].rgb.shape
    assert sheet.shape == (512, 512, 3)


def test_segments_of_a_sheet_that_is_never_answered_are_asked_about_one_by_one(table: Table) -> None:
    asked: list[list[int]] = []
    eyes = Eyes(says={}, spoilt=(2,), meet=asked.append)
    found = describe_segments(table.records, 4, table.photo, table.services(eyes))
    assert asked[:3] == [[1, 2, 3]] * 3 and sorted(asked[3:]) == [[1], [2], [2], [2], [3]]
    assert [found.descriptions[one].description for one in (1, 3)] == ["thing 1", "thing 3"]
    (note,) = found.notes
    assert note.startswith("candidate 2: the describe model gave no usable reply")


@pytest.mark.parametrize(("side", "count", "sizes"), [(120, 36, [36]), (120, 37, [18, 19]), (400, 10, [5, 5])])
def test_a_sheet_holds_as_many_crops_as_are_legible(table: Table, side: int, count: int, sizes: list[int]) -> None:
    """36 crops of 170 pixels at most; of large crops 9, which are reduced to 341."""
    record = table.records[0]
    cv2.imwrite(str(table.folder / record.crop), np.full((side, side // 2, 3), 200, np.uint8))
    records = [record.model_copy(update={"id": number}) for number in range(1, count + 1)]
    groups = group_segments_for_sheets(records, table.folder)
    assert [len(group) for group in groups] == sizes
    assert [one.id for group in groups for one in group] == list(range(1, count + 1))
    sheet = cv2.imread(str(table.folder / write_segment_sheet(groups[0], table.folder)))
    assert sheet is not None and max(sheet.shape) <= 1024
    assert sheet.shape[1] // int(np.ceil(len(groups[0]) ** 0.5)) >= min(side, 341) >= 120
