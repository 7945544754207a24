"""Replies of the agents, as frozen types."""

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Annotated, Any, Literal, cast, get_args, get_origin

from pydantic import BeforeValidator, ConfigDict, Field, ValidationInfo, field_validator, model_validator

from grs_agents.base import Frozen

Verdict = Literal["fix_code", "fix_test", "fix_task"]
"""The router's two answers in the paper's spelling, and ``fix_task``: the task cannot be done as defined."""
ToolFunction = Callable[..., str | list[Any]]
"""A tool of a model: it returns words, or content blocks such as a picture."""


@dataclass(frozen=True)
class ToolCalling:
    """Tools of an agent, the number of calls, and the graph."""

    tools: Mapping[str, ToolFunction]  # by name; the model reads the docstring and the annotations
    steps: int  # calls of tools in all
    graph: str  # for messages


_NULLS = frozenset({"", "-", "n/a", "na", "nil", "none", "null", "undefined"})
_SEGMENT_NUMBER = re.compile(r"(?:segment|no\.|#)\s*(\d+)", re.IGNORECASE)


def _read_null_word(value: Any) -> Any:
    return None if isinstance(value, str) and value.strip().lower() in _NULLS else value


def _read_unknown_word(value: Any) -> Any:
    return (
        None if isinstance(value, str) and value.strip().lower() in ("unclear", "unknown") else _read_null_word(value)
    )


def _read_segment_number(value: Any) -> Any:
    number = _SEGMENT_NUMBER.fullmatch(value.strip()) if isinstance(value, str) else None
    return number[1] if number else _read_null_word(value)


class ModelReply(Frozen):
    """A model's JSON reply; keys and choices may differ in capitals, dashes, blanks or underscores."""

    model_config = ConfigDict(frozen=True, extra="ignore", populate_by_name=True)

    @model_validator(mode="before")
    @classmethod
    def _respell_keys(cls, value: Any) -> Any:
        if not isinstance(value, dict):
            return value
        table = cast("dict[Any, Any]", value)
        names = (*cls.model_fields, *(field.alias for field in cls.model_fields.values() if field.alias))
        spelt = {_letters(name): name for name in names}
        respelt = {key: spelt.get(_letters(str(key)), key) for key in table}
        unique = len(set(respelt.values())) == len(table)
        return cls.fill_missing_words({respelt[key]: table[key] for key in table} if unique else table)

    @classmethod
    def fill_missing_words(cls, table: dict[Any, Any]) -> dict[Any, Any]:
        """Fill in fields of ``table`` that follow from its other fields."""
        return table

    @field_validator("*", mode="before")
    @classmethod
    def _respell_choice(cls, value: Any, info: ValidationInfo) -> Any:
        annotation = cls.model_fields[info.field_name or ""].annotation
        if get_origin(annotation) is not Literal or not isinstance(value, str):
            return value
        return next((choice for choice in get_args(annotation) if _letters(choice) == _letters(value)), value)


def _letters(text: str) -> str:
    return re.sub(r"[\s_-]", "", text).lower()


class Description(ModelReply):
    """The describer's reply about a segmented crop (paper, Scene Comprehension, step 2)."""

    is_object: bool
    description: str = Field(min_length=1)
    color: str
    shape: str
    category: str
    # the segment that shows the rest of the same object
    part_of: Annotated[int | None, BeforeValidator(_read_segment_number)] = None
    # open at the top, so that objects can be put into it; None if unknown
    open_top: Annotated[bool | None, BeforeValidator(_read_unknown_word)] = None


class SegmentReply(Description):
    """A description in a reply about several segments; ``id`` is the segment's number."""

    id: Annotated[int | None, BeforeValidator(_read_segment_number)] = None

    @classmethod
    def fill_missing_words(cls, table: dict[Any, Any]) -> dict[Any, Any]:
        """Fill in missing fields of a segment that is no object."""
        if str(table.get("is_object")).lower() not in ("false", "no", "0"):
            return table
        words = {"description": "no object", "color": "", "shape": "", "category": ""}
        return {**words, **{key: text for key, text in table.items() if key not in words or text not in (None, "")}}


class Match(ModelReply):
    """The matcher's reply about a candidate (paper, Scene Comprehension, step 3).

    ``asset`` names a library asset; ``no_asset`` is a real object that the library lacks; ``no_object`` is a
    segment that is not an object at all.
    """

    match: Literal["asset", "no_asset", "no_object"]
    asset: Annotated[str | None, BeforeValidator(_read_null_word)] = None
    reason: str = ""


class TaskDefinition(ModelReply):
    """The paper's three fields, with its spelling in JSON."""

    model_config = ConfigDict(serialize_by_alias=True)

    name: str = Field(alias="task-name", min_length=1, max_length=100)
    description: str = Field(alias="task-description", min_length=1)
    assets: tuple[str, ...] = Field(alias="assets-used", min_length=1)

    @field_validator("name")
    @classmethod
    def normalize_task_name(cls, name: str) -> str:
        """Task names become file and class names: letters, digits and dashes."""
        slug = re.sub(r"[^a-z0-9]+", "-", name.lower()).strip("-")
        if not slug:
            raise ValueError("task-name needs letters or digits")
        return slug

    def as_json(self) -> dict[str, Any]:
        """The definition as the paper prints it."""
        return self.model_dump(mode="json")

    def __getitem__(self, key: str) -> Any:
        """A field by its name in JSON (``state["task"]["task-name"]``); deprecated: earlier states held JSON."""
        return self.as_json()[key]


class TaskRevision(TaskDefinition):
    """A revised task, after the original could not be done, and the part that was given up."""

    given_up: str = Field(alias="given-up", min_length=1, max_length=500)

    def as_definition(self) -> TaskDefinition:
        """The task alone."""
        return TaskDefinition.model_validate(self.as_json())


class RouterReply(Frozen):
    """The router's explanation and verdict."""

    verdict: Verdict
    explanation: str


class WordsJudgement(ModelReply):
    """The judge's verdict on the agreement of a task's words with its goals."""

    # ``unclear``: the judge does not understand the words, or they are ambiguous
    verdict: Literal["agrees", "differs", "unclear"]
    reason: str = Field(min_length=1)


class NoReply(Frozen):
    """A role whose model gave no usable reply: an outcome, not an exception."""

    role: str
    tries: int  # number of refused replies
    problem: str  # of the last reply

    def __str__(self) -> str:
        return f"the {self.role} model gave no usable reply in {self.tries} tries: {self.problem}"
