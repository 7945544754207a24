"""Frames survive any cutting of the stream, and nothing but plain JSON passes."""

import struct

import pytest
from hypothesis import given
from hypothesis import strategies as st

from grs_agents.sandbox.protocol.wire import (
    MAX_BODY,
    ForgedFrameError,
    FrameError,
    FrameReader,
    decode,
    encode,
    extract_json_punctuation,
    new_key,
    sign_frame,
)

text = st.text(st.characters(exclude_categories=["Cs"]), max_size=20)
plain = st.recursive(
    st.none() | st.booleans() | st.integers(-(2**60), 2**60) | st.floats(allow_nan=False, allow_infinity=False) | text,
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(text, inner, max_size=3),
    max_leaves=10,
)


@given(st.lists(st.dictionaries(text, plain, max_size=3), max_size=4), st.integers(1, 50))
def test_frames_come_back_however_the_stream_is_cut(frames: list[dict[str, object]], size: int) -> None:
    stream = b"".join(encode(frame) for frame in frames)
    reader = FrameReader()
    found = [one for at in range(0, len(stream), size) for one in reader.feed(stream[at : at + size])]
    assert found == frames


@given(st.binary(max_size=200))
def test_any_bytes_are_a_frame_or_a_frame_error(data: bytes) -> None:
    try:
        frames = FrameReader().feed(struct.pack("!I", len(data)) + data)
    except FrameError:
        return
    assert FrameReader().feed(encode(frames[0])) == frames


@pytest.mark.parametrize(
    "body",
    [
        "NaN",
        '{"x": Infinity}',
        '{"x": 1e999}',
        '{"x": "\\ud800"}',
        "[" * 100_000,
        "[]",
        "",
        '{"x": 9223372036854775808}',
        '{"x": ' + "9" * 5000 + "}",
        '{"x":' * 65 + "1" + "}" * 65,
    ],
)
def test_what_json_cannot_carry_on_is_refused(body: str) -> None:
    with pytest.raises(FrameError):
        decode(body.encode(), extract_json_punctuation(body.encode()))


def test_brackets_and_commas_in_strings_count_for_nothing() -> None:
    frame = {"x": '[{,"\\' * 200_000}
    assert FrameReader().feed(encode(frame)) == [frame]


def test_the_brackets_and_commas_of_a_call_are_bounded_over_all_its_frames() -> None:
    reader, frame = FrameReader(), encode({"x": [[]] * 100_000})
    reader.feed(frame)
    with pytest.raises(FrameError, match="more than 500000"):
        reader.feed(frame)


@pytest.mark.parametrize("value", [float("nan"), float("inf"), object(), {1, 2}])
def test_only_plain_json_is_sent(value: object) -> None:
    with pytest.raises((ValueError, TypeError)):
        encode({"x": value})


def test_lone_surrogates_are_replaced_when_sent() -> None:
    body = encode({"x": "a\ud800"})[4:]
    assert decode(body, extract_json_punctuation(body)) == {"x": "a?"}


KEY = bytes.fromhex(new_key())


def keyed_reader() -> FrameReader:
    reader = FrameReader()
    reader.require_key(KEY)
    return reader


@given(st.lists(st.dictionaries(text, plain, max_size=3), min_size=1, max_size=4), st.data())
def test_sealed_frames_come_back_and_no_changed_byte_passes(
    frames: list[dict[str, object]], data: st.DataObject
) -> None:
    stream = bytearray(b"".join(sign_frame(encode(frame), KEY, number) for number, frame in enumerate(frames)))
    assert keyed_reader().feed(bytes(stream)) == frames
    stream[data.draw(st.integers(0, len(stream) - 1))] ^= data.draw(st.integers(1, 255))
    found: list[dict[str, object]] = []
    try:
        found += keyed_reader().iterate_frames(bytes(stream))
    except ForgedFrameError:
        return
    assert found == frames[: len(found)] and len(found) < len(frames)  # it waits for the end of a longer frame


ONE = encode({"x": 1})
FORGED = {
    "no seal": ONE,
    "another key": sign_frame(ONE, bytes.fromhex(new_key()), 0),
    "number skipped": sign_frame(ONE, KEY, 1),
    "sent twice": sign_frame(ONE, KEY, 0) * 2,
    "another order": sign_frame(ONE, KEY, 0) + sign_frame(ONE, KEY, 2) + sign_frame(ONE, KEY, 1),
    "longer than any": struct.pack("!I", MAX_BODY + 1),
    "empty": struct.pack("!I", 0),
}


@pytest.mark.parametrize("name", FORGED)
def test_frames_of_another_hand_are_told_apart(name: str) -> None:
    with pytest.raises(ForgedFrameError):
        keyed_reader().feed(FORGED[name])


def test_what_came_before_a_forged_frame_counts() -> None:
    found: list[dict[str, object]] = []
    with pytest.raises(ForgedFrameError):
        for frame in keyed_reader().iterate_frames(sign_frame(ONE, KEY, 0) + ONE):
            found.append(frame)
    assert found == [{"x": 1}]
