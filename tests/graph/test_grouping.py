"""The node that asks a model which segments belong together, between segmentation and description."""

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from langchain_core.messages import AIMessage
from langgraph.runtime import Runtime

from grs_agents.base.config.schema import Config
from grs_agents.base.trace.events import Prompt, SceneStage
from grs_agents.base.trace.log import read_events
from grs_agents.graph.grouping import group_candidates, next_step_after_segment
from grs_agents.graph.policies.policy_registry import load_policy
from grs_agents.graph.services import Services
from grs_agents.graph.state import RunState, TableObject, parse_state, select_pending
from grs_agents.perception.annotated_pictures import MARKS, SHOWN_SIDE
from grs_agents.perception.picture_files import load_mask, round_depth_as_saved, save_candidates, save_frame, write_png
from grs_agents.perception.segmentation.candidates import measure_candidates
from grs_agents.perception.types import Mask, RGBDFrame
from grs_agents.sandbox.host.sandbox import Sandbox
from tests.graph.conftest import fenced, run
from tests.perception.settling.photo import BLOCK, LIBRARY, MILK, WIDTH, photo_of, standing
from tests.scripted import ScriptedAgents, scripted

NOTHING: dict[str, Any] = {"merge": [], "split": [], "drop": [], "missing": []}
SEEING: dict[str, Any] = {"models": {"default": {"model": "openai:any"}}}
SCALE = SHOWN_SIDE / WIDTH


@pytest.fixture
def photo(tmp_path: Path) -> tuple[RunState, RGBDFrame, list[Mask]]:
    """A segmented photo: the two halves of a carton and a block, as segments 1 to 3; masks of carton and block."""
    things = [standing(MILK, 0.55, 0.0), standing(BLOCK, 0.42, 0.15)]
    frame, table, every = photo_of(things, LIBRARY)
    block = photo_of(things[1:], LIBRARY)[2] & every
    carton = every & ~block
    upper = carton & (np.arange(len(carton))[:, None] < np.median(np.nonzero(carton)[0]))
    save_frame(frame, tmp_path)
    found = measure_candidates(frame, table, every.astype("int32") + upper + 2 * block)
    records = save_candidates(frame, found, tmp_path)
    nothing = np.zeros(every.shape, np.uint8)
    for name in ("left_out", "robot", "blur"):
        write_png(tmp_path / f"scene/{name}.png", nothing)
    state: dict[str, Any] = {
        "scene_path": "photo",
        "max_fixes": 2,
        "notes": ["read"],
        "image": "scene/rgb.png",
        "camera": frame.camera,
        "table": table,
        "objects": [TableObject.from_record(record) for record in records],
        "dropped": [],
        "background": "",
        **{name: f"scene/{name}.png" for name in ("left_out", "robot", "blur")},
    }
    return parse_state(state), frame, [carton, block]


def services_of(
    folder: Path, sandbox: Sandbox, replies: Sequence[str | AIMessage | Exception], **settings: Any
) -> Services:
    """The services of a run whose models give the replies."""
    config = Config.model_validate({**SEEING, **settings})
    agents = scripted(folder, replies, config)
    return Services(config, agents.log, agents, load_policy("llm"), sandbox, folder)


def shown_box(mask: Mask, spill: int = 0) -> list[int]:
    """The rectangle of a mask in the picture that the model sees."""
    rows, columns = np.nonzero(mask)
    x, y = int(columns.min()) - spill, int(rows.min()) - spill
    wide, high = int(columns.max()) + 1 + spill - x, int(rows.max()) + 1 + spill - y
    return [round(SCALE * side) for side in (x, y, wide, high)]


def group(
    photo: tuple[RunState, RGBDFrame, list[Mask]], folder: Path, sandbox: Sandbox, said: object
) -> tuple[dict[str, Any], Services]:
    """The node's update of the state for a reply, and the services."""
    state, frame, _ = photo
    text = said if isinstance(said, str) else fenced(json.dumps(said), "json")
    services = services_of(folder, sandbox, [text] * 3)
    services.cache_photo(round_depth_as_saved(frame, "photo"))
    return run(group_candidates, state, services), services


Photo = tuple[RunState, RGBDFrame, list[Mask]]


def test_the_model_sees_all_segments_numbered_and_is_asked_once(photo: Photo, tmp_path: Path, sandbox: Sandbox) -> None:
    update, services = group(photo, tmp_path, sandbox, NOTHING)
    assert update == {"notes": ["read"]}
    events = read_events(services.log.path)
    (prompt,) = [event for event in events if isinstance(event, Prompt)]
    assert prompt.role == "group" and prompt.images == (MARKS,)
    rows = [json.loads(line) for line in prompt.text.splitlines() if line.startswith('{"id"')]
    assert [row["id"] for row in rows] == [1, 2, 3]
    assert rows[2]["box"] == shown_box(photo[2][1]) and rows[0]["near"] == [2]
    assert "1024 x 768 pixels" in prompt.text
    (stage,) = [event for event in events if isinstance(event, SceneStage)]
    assert stage.stage == "grouped" and stage.files == {"marks": MARKS}


def test_what_the_model_says_becomes_the_segments(photo: Photo, tmp_path: Path, sandbox: Sandbox) -> None:
    said = {**NOTHING, "merge": [[1, 2]], "drop": [{"segment": 3, "what": "robot"}]}
    update, services = group(photo, tmp_path, sandbox, said)
    assert [item.id for item in update["objects"]] == [1, 2, 3, 4]
    (carton,) = select_pending(update["objects"], update["dropped"])
    assert carton.id == 4 and np.array_equal(load_mask(tmp_path / carton.mask), photo[2][0])
    assert [item.reason for item in update["dropped"]][2] == "scenery: robot"
    assert np.array_equal(load_mask(tmp_path / "scene/left_out.png"), photo[2][1])  # it does not count as uncovered
    stage = [event for event in read_events(services.log.path) if isinstance(event, SceneStage)][-1]
    assert [item["id"] for item in stage.summary["objects"]] == [4]
    labels = load_mask(tmp_path / stage.files["masks"])
    assert np.array_equal(labels, photo[2][0])


def test_boxes_are_pixels_of_the_picture_that_was_shown(photo: Photo, tmp_path: Path, sandbox: Sandbox) -> None:
    state, *_ = photo
    without = parse_state({**state, "objects": state["objects"][:2]})
    said = {**NOTHING, "missing": [{"what": "block", "box": shown_box(photo[2][1], spill=4)}]}
    update, _ = group((without, *photo[1:]), tmp_path, sandbox, said)
    block = update["objects"][-1]
    mask = load_mask(tmp_path / block.mask)
    assert block.id == 3 and np.count_nonzero(mask & photo[2][1]) > 0.9 * np.count_nonzero(mask | photo[2][1])


def test_boxes_that_divide_a_segment_are_pixels_of_that_picture_too(
    photo: Photo, tmp_path: Path, sandbox: Sandbox
) -> None:
    state, frame, (carton, _) = photo
    upper = load_mask(tmp_path / state["objects"][0].mask)
    columns = np.arange(frame.depth.shape[1])
    left = carton & (columns < np.median(np.nonzero(upper)[1])) & upper
    said = {**NOTHING, "split": [{"segment": 1, "boxes": [shown_box(left), shown_box(upper & ~left)]}]}
    update, _ = group(photo, tmp_path, sandbox, said)
    parts = select_pending(update["objects"], update["dropped"])[2:]
    assert [part.id for part in parts] == [4, 5]
    mask = load_mask(tmp_path / parts[0].mask)
    assert np.count_nonzero(mask & left) > 0.7 * np.count_nonzero(mask | left)


def test_a_statement_that_cannot_be_applied_is_a_note(photo: Photo, tmp_path: Path, sandbox: Sandbox) -> None:
    said = {
        "merge": [[1, 3], [88, 2]],
        "split": [{"segment": 3, "boxes": [[-900, -900, 5, 5], [5000, 5000, 9, 9]]}],
        "missing": [{"what": "ghost", "box": [4000, 4000, 10, 10]}],
    }
    update, _ = group(photo, tmp_path, sandbox, said)
    assert set(update) == {"notes"}
    assert len(update["notes"]) == 5
    assert all(note.startswith("regrouping: ") for note in update["notes"][1:])


MANY = 10**5


@pytest.mark.parametrize(
    ("said", "problem"),
    [
        ("I see a table.", "no block fenced"),
        ({"merge": "all of them"}, "merge"),
        ({"drop": [{"what": "robot"}]}, "segment is missing"),
        ({"merge": [[1, 2]] * MANY}, "at most 100 items"),
        ({"merge": [[1] * MANY]}, "at most 100 items"),
        ({"drop": [{"segment": 1}] * (MANY // 5)}, "at most 100 items"),
        ({"split": [{"segment": 1, "boxes": [[0, 0, 1, 1]] * (MANY // 2)}]}, "at most 30 items"),
        ('```json\n{"missing": [{"what": "cup", "box": [0, 0, NaN, 1e999]}]}\n```', "box"),
        ({"missing": [{"what": "cup", "box": [0, 0, -5, 10]}]}, "greater than 0"),
        ({"split": [{"segment": 10**400, "boxes": [[0, 0, 1, 1]]}]}, "segment"),
        ("```json\n" + "[" * MANY + "\n```", "JSON"),
    ],
    ids=lambda value: str(value)[:20] if isinstance(value, str) else "reply",
)
def test_a_reply_of_the_wrong_form_leaves_the_segmentation(
    photo: Photo, tmp_path: Path, sandbox: Sandbox, said: object, problem: str
) -> None:
    update, services = group(photo, tmp_path, sandbox, said)
    assert set(update) == {"notes"}
    note = update["notes"][-1]
    assert note.startswith("the group model gave no usable reply in 3 tries: ") and problem in note
    assert note.endswith(": the segmentation stays as it is") and len(note) < 5000
    assert isinstance(services.agents, ScriptedAgents) and not services.agents.script.replies


def test_a_sloppy_reply_is_understood(photo: Photo, tmp_path: Path, sandbox: Sandbox) -> None:
    update, _ = group(photo, tmp_path, sandbox, "{'Merge': [{'segments': ['segment 1', '#2'],},], drop: None}")
    assert [item.id for item in select_pending(update["objects"], update["dropped"])] == [3, 4]


@pytest.mark.parametrize(
    "form",
    ["{} Hope it helps!", "Sure:\n\n```json\n{}\n```\nThese are my corrections.", "{}", "<answer>\n{}\n</answer>"],
    ids=["after", "around", "bare", "tag"],
)
def test_words_around_a_reply_do_not_matter(photo: Photo, tmp_path: Path, sandbox: Sandbox, form: str) -> None:
    said = '{"merge": [[1, 2],], "split": [], "drop": [{"segment": "3", "what": "robot"},], "missing": []}'
    update, _ = group(photo, tmp_path, sandbox, form.replace("{}", said))
    assert [item.id for item in select_pending(update["objects"], update["dropped"])] == [4]


@pytest.mark.parametrize(
    "said",
    [
        {"merge": [1, 2], "drop": [3]},
        {"merge": [{"what": "carton", "segments": ["1", 2]}], "drop": [{"id": "segment 3"}]},
        {"merge": [["Segment 1", "no. 2"]], "drop": [{"segment": "3", "what": None}], "comment": "done"},
    ],
)
def test_segments_may_be_named_in_any_clear_way(
    photo: Photo, tmp_path: Path, sandbox: Sandbox, said: dict[str, Any]
) -> None:
    update, _ = group(photo, tmp_path, sandbox, said)
    assert [item.id for item in select_pending(update["objects"], update["dropped"])] == [4]


@pytest.mark.parametrize("form", ["sides", "keys", "named", "corners", "corner keys", "shares"])
def test_boxes_may_have_any_clear_form(photo: Photo, tmp_path: Path, sandbox: Sandbox, form: str) -> None:
    """Corners are clear for boxes that could not be told by their sides."""
    state, frame, (carton, _) = photo
    upper = load_mask(tmp_path / state["objects"][0].mask)
    left = carton & (np.arange(frame.depth.shape[1]) < np.median(np.nonzero(upper)[1])) & upper

    def spell(mask: Mask) -> object:
        x, y, wide, high = shown_box(mask)
        return {
            "sides": [x, str(y), wide, high],
            "keys": {"X": x, "y": y, "width": wide, "height": high},
            "named": {"what": "half", "box": [x, y, wide, high]},
            "corners": [x, y, x + wide, y + high],
            "corner keys": {"x1": x, "y1": y, "x2": x + wide, "y2": y + high},
            "shares": [x / SHOWN_SIDE, y / 768, wide / SHOWN_SIDE, high / 768],
        }[form]

    said = {"split": [{"id": "#1", "boxes": [spell(left), spell(upper & ~left)]}], "drop": ["1B"]}
    update, _ = group(photo, tmp_path, sandbox, said)
    kept = select_pending(update["objects"], update["dropped"])
    assert [item.id for item in kept] == [2, 3, 4]
    mask = load_mask(tmp_path / kept[2].mask)
    assert np.count_nonzero(mask & left) > 0.7 * np.count_nonzero(mask | left)
    assert {item.id: item.reason for item in update["dropped"]}[5] == "scenery: no object"


def test_the_rest_of_an_object_is_added_to_its_segment(photo: Photo, tmp_path: Path, sandbox: Sandbox) -> None:
    state, *_ = photo
    without = parse_state({**state, "objects": state["objects"][1:]})
    said = {"missing": [{"what": "top", "box": shown_box(photo[2][0], spill=4), "part_of": 2}]}
    update, _ = group((without, *photo[1:]), tmp_path, sandbox, said)
    _, carton = select_pending(update["objects"], update["dropped"])
    mask = load_mask(tmp_path / carton.mask)
    assert np.count_nonzero(mask & photo[2][0]) > 0.9 * np.count_nonzero(mask | photo[2][0])


def test_the_number_of_a_small_segment_stands_beside_it(photo: Photo, tmp_path: Path, sandbox: Sandbox) -> None:
    state, frame, (_, block) = photo
    row, column = (round(float(np.mean(side))) for side in np.nonzero(block))
    dot = np.zeros_like(block)
    dot[row - 2 : row + 3, column - 2 : column + 3] = True
    write_png(tmp_path / state["objects"][2].mask, dot.astype(np.uint8) * 255)
    group(photo, tmp_path, sandbox, NOTHING)
    marks = cv2.imread(str(tmp_path / MARKS))
    assert marks is not None
    shown = marks[round(SCALE * (row + 0.5)), round(SCALE * (column + 0.5))].astype(int)
    assert np.abs(shown - frame.rgb[row, column][::-1]).max() < 40 or (shown == 255).all()  # the leader ends there
    hidden = (marks == 0).all(axis=2)[round(SCALE * (row - 2)) : round(SCALE * (row + 3)) : 1]
    assert not hidden[:, round(SCALE * (column - 1)) : round(SCALE * (column + 2))].all()


@pytest.mark.parametrize(
    ("settings", "given", "step"),
    [
        ({}, False, "group"),
        ({"scene": {"group": "off"}}, False, "describe"),
        ({"models": {"default": {"model": "offline"}}}, False, "describe"),
        ({"models": {"default": {"model": "offline"}, "group": {"model": "openai:any"}}}, False, "group"),
        ({}, True, "describe"),
        ({"cassette": "groceries-sort"}, False, "describe"),
    ],
    ids=["seeing", "off", "offline", "role", "given", "cassette"],
)
def test_only_a_model_that_sees_is_asked(
    photo: Photo, tmp_path: Path, sandbox: Sandbox, settings: dict[str, Any], given: bool, step: str
) -> None:
    objects = [item.model_copy(update={"given": given}) for item in photo[0]["objects"]]
    services = services_of(tmp_path, sandbox, [], **settings)
    assert next_step_after_segment({**photo[0], "objects": objects}, runtime=Runtime(context=services)) == step


def test_a_model_that_reads_text_alone_is_not_asked(photo: Photo, tmp_path: Path, sandbox: Sandbox) -> None:
    services = services_of(tmp_path, sandbox, [])
    assert isinstance(services.agents, ScriptedAgents)
    services.agents.script.profile = {"image_inputs": False}
    assert next_step_after_segment(photo[0], runtime=Runtime(context=services)) == "describe"
