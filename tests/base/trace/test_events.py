"""The vocabulary of events."""

import json
import typing
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import BaseModel, ValidationError

from grs_agents.base.trace.events import EVENT, VERSION, Event, Note, Reply, SceneStage, event_schema

KINDS: tuple[type[BaseModel], ...] = typing.get_args(typing.get_args(Event)[0])
ANY_TEXT = st.text(st.characters(exclude_categories=()))
EVENTS = st.one_of(
    st.builds(Note, text=ANY_TEXT),
    st.builds(Reply, call=ANY_TEXT, role=ANY_TEXT, model=ANY_TEXT, text=ANY_TEXT, seconds=st.floats(0, 1e6)),
    st.builds(SceneStage, stage=st.just("frame"), summary=st.dictionaries(ANY_TEXT, ANY_TEXT | st.floats())),
)


@given(EVENTS)
def test_every_event_survives_a_line_of_json(event: Event) -> None:
    line = EVENT.dump_json(event)
    assert b"\n" not in line
    assert EVENT.validate_json(line) == event


def test_the_schema_describes_every_kind() -> None:
    schema = event_schema()
    assert set(schema["discriminator"]["mapping"]) == {kind.model_fields["kind"].default for kind in KINDS}
    assert all(kind.__doc__ for kind in KINDS)


def test_events_carry_version_number_time_and_attempt() -> None:
    for kind in KINDS:
        assert {"version", "sequence", "time", "attempt"} <= set(kind.model_fields)
        assert kind.model_fields["version"].default == VERSION


@pytest.mark.parametrize("line", ['{"kind": "party"}', '{"kind": "note", "text": "x", "colour": 1}', '{"text": "x"}'])
def test_what_is_no_event_is_refused(line: str) -> None:
    with pytest.raises(ValidationError):
        EVENT.validate_json(line)


def test_the_published_schema_is_the_present_one() -> None:
    published = Path(__file__).parents[3] / "docs" / "events.schema.json"
    assert json.loads(published.read_text("utf-8")) == event_schema(), (
        "run: grs list --schema > docs/events.schema.json"
    )
