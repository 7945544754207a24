"""Replies that were given before: which prompt is the same, and which reply is next."""

from concurrent.futures import ThreadPoolExecutor

import pytest
from langchain_core.messages import AIMessage, BaseMessage, HumanMessage

from grs_agents.agents.recorded import Cassette, RecordedReplies, collect_exchanges, digest_prompt
from grs_agents.base.trace.events import Prompt, Reply


def asked(text: str, picture: str = "AAAA", *more: BaseMessage) -> list[BaseMessage]:
    """A conversation that begins with a picture and a text."""
    block = {"type": "image", "base64": picture, "mime_type": "image/jpeg"}
    return [HumanMessage([block, {"type": "text", "text": text}]), *more]


def digest(text: str, picture: str = "AAAA", name: str = "rgb.png", *more: BaseMessage, role: str = "task") -> str:
    return digest_prompt(role, asked(text, picture, *more), [name])


def reply(text: str) -> Reply:
    return Reply(call="", role="task", model="any", text=text)


BOX = "The box is 0.12 m wide, at [-0.30, 4e-05], beside red_box_1."


@pytest.mark.parametrize(
    "other", [digest(BOX.replace("0.12", "0.1").replace("4e-05", "0")), digest(BOX, "BBBB")], ids=["numbers", "pixels"]
)
def test_what_another_machine_measures_and_renders_changes_the_second_half(other: str) -> None:
    assert other[:32] == digest(BOX)[:32] and other[32:] != digest(BOX)[32:]


@pytest.mark.parametrize(
    "other",
    [
        digest(BOX.replace("wide", "long")),
        digest(BOX.replace("box_1", "box_2")),
        digest(BOX, "AAAA", "crop.png"),
        digest(BOX, role="match"),
        digest(BOX, "AAAA", "rgb.png", AIMessage("It is."), HumanMessage("Again.")),
    ],
    ids=["word", "name", "picture", "role", "conversation"],
)
def test_another_prompt_has_another_first_half(other: str) -> None:
    assert other[:32] != digest(BOX)[:32]


def test_equal_prompts_get_their_replies_in_order_and_each_once() -> None:
    replies = RecordedReplies([(digest(BOX), reply("one")), (digest("?"), reply("two")), (digest(BOX), reply("three"))])
    taken = [replies.take_reply(digest(BOX)) for _ in range(3)]
    assert [item and item.text for item in taken] == ["one", "three", None]


def test_a_recording_of_another_machine_answers_after_what_fits_exactly() -> None:
    exchanges = [(digest("0.1 m"), reply("near")), (digest("0.2 m"), reply("exact"))]
    strict, tolerant = RecordedReplies(exchanges), RecordedReplies(exchanges, tolerant=True)
    assert strict.take_reply(digest("0.3 m")) is None
    taken = [tolerant.take_reply(digest(text)) for text in ("0.2 m", "0.3 m", "0.3 m", "3 feet")]
    assert [item and item.text for item in taken] == ["exact", "near", None, None]


def test_a_repeated_run_that_was_interrupted_goes_on_behind_what_it_was_given() -> None:
    replies = [reply(text).model_copy(update={"call": text}) for text in ("one\n\n two", "three")]
    prompts = [Prompt(call=item.call, role="task", model="any", text=BOX, digest=digest(BOX)) for item in replies]
    exchanges = collect_exchanges([*prompts, *reversed(replies)])
    nothing = dict.fromkeys(("version", "scene", "status", "reason"), "")
    cassette = Cassette(**nothing, settings={}, files={}, exchanges=exchanges)
    first = cassette.remaining_replies([]).take_reply(digest(BOX))
    second = cassette.remaining_replies([prompts[0], replies[0], prompts[1]]).take_reply(digest(BOX))
    assert first and second and [first.text, second.text] == ["one\n\n two", "three"]


def test_threads_that_ask_at_once_get_each_reply_once() -> None:
    replies = RecordedReplies((digest(BOX), reply(str(number))) for number in range(200))
    with ThreadPoolExecutor(8) as threads:
        taken = list(threads.map(lambda _: replies.take_reply(digest(BOX)), range(250)))
    assert sorted(int(item.text) for item in taken if item) == list(range(200))
