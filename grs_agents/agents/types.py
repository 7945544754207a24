"""Replies of the agents, as frozen types."""

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Annotated, Any, Literal, cast, get_args, get_origin

from pydantic import (
    AliasChoices,
    BeforeValidator,
    ConfigDict,
    Field,
    ValidationInfo,
    WithJsonSchema,
    field_validator,
    model_validator,
)
from pydantic.json_schema import SkipJsonSchema

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
_SEGMENT = re.compile(r"(?:segment|candidate|no\.|#)?\s*(\d+)[\s_.-]?([a-z]?)", re.IGNORECASE)


def _read_null_word(value: Any) -> Any:
    return None if isinstance(value, str) and value.strip().lower() in _NULLS else value


def _read_unknown_word(value: Any) -> Any:
    return (
        None if isinstance(value, str) and value.strip().lower() in ("unclear", "unknown") else _read_null_word(value)
    )


def _read_segment_name(value: Any) -> Any:
    """``3`` of ``segment 3``, and ``3b`` of ``Segment 3-B``."""
    name = _SEGMENT.fullmatch(value.strip()) if isinstance(value, str) else None
    return f"{name[1]}{name[2].lower()}" if name else _read_null_word(value)


def _shorten(value: Any) -> Any:
    return " ".join(value.split())[:60] if isinstance(value, str) else ""


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


_SIDES = (("left", "top", "width", "height"), ("x", "y", "width", "height"), ("x", "y", "w", "h"))
_CORNERS = (
    ("left", "top", "right", "bottom"),
    ("x1", "y1", "x2", "y2"),
    ("x0", "y0", "x1", "y1"),
    ("xmin", "ymin", "xmax", "ymax"),
)


def _read_box(value: Any) -> Any:
    """The sides of a box that is an object: of its sides, its corners, or the box of an object beside its name."""
    if isinstance(value, dict) and len(named := [key for key in ("box", "bbox") if key in value]) == 1:
        value = cast("dict[Any, Any]", value)[named[0]]
    if not isinstance(value, dict):
        return value
    written = cast("dict[Any, Any]", value)
    table = {_letters(str(key)): item for key, item in written.items()}
    for keys in _SIDES:
        if table.keys() >= set(keys):
            return [table[key] for key in keys]
    for keys in _CORNERS:
        if table.keys() >= set(keys):
            try:
                left, top, right, bottom = (float(table[key]) for key in keys)
            except (TypeError, ValueError, OverflowError):
                return written
            return [left, top, right - left, bottom - top]
    return written


def _read_items(value: Any) -> Any:
    """The items of a list; nothing for null or an empty object, and a single object for itself."""
    return () if value is None or value == {} else [value] if isinstance(value, dict) else value


def _fill_number(table: dict[Any, Any]) -> dict[Any, Any]:
    """The segment's number under another key than ``id``."""
    named = [key for key in table if _letters(str(key)) in ("segment", "segmentid", "segmentnumber", "number")]
    return {**table, "id": table[named[0]]} if "id" not in table and len(named) == 1 else table


_Edge = Annotated[float, Field(ge=-(10**6), le=10**6, allow_inf_nan=False)]
_Length = Annotated[float, Field(gt=0, le=10**6, allow_inf_nan=False)]
PictureBox = Annotated[tuple[_Edge, _Edge, _Length, _Length], BeforeValidator(_read_box)]
"""Left, top, width and height, pixels of the picture that the model saw."""


Word = Annotated[str, BeforeValidator(lambda value: "" if value is None else value)]
NO_OBJECT = ["several things", "robot", "background", "nothing"]
"""Words of a describer in place of ``is_object``."""


class Description(ModelReply):
    """The describer's reply about a segmented crop (paper, Scene Comprehension, step 2)."""

    is_object: Annotated[bool, WithJsonSchema({"anyOf": [{"type": "boolean"}, {"type": "string", "enum": NO_OBJECT}]})]
    description: str = Field(min_length=1)
    color: Word
    shape: Word
    category: Word
    # the segment that shows the rest of the same object
    part_of: Annotated[int | None, BeforeValidator(_read_segment_name)] = None
    # open at the top, so that objects can be put into it; None if unknown
    open_top: Annotated[bool | None, BeforeValidator(_read_unknown_word)] = None
    # `several` for a segment of several objects, a name for scenery, else empty: read from the words of `is_object`
    shows: SkipJsonSchema[Annotated[str, BeforeValidator(_shorten)]] = ""
    # of the several objects, in the photo that the describer saw
    boxes: Annotated[tuple[PictureBox, ...], BeforeValidator(_read_items), Field(max_length=30)] = ()


_SEVERAL = re.compile(r"(several|multiple|many|more than one|two|three)\b", re.IGNORECASE)
_PART = re.compile(r"(?:a )?(?:part|piece) of (?:the )?(?:segment |no\. ?|#)?(\d+)", re.IGNORECASE)
_SCENERY = re.compile(
    r"(?:an? |the )?(robot|arm|hand|person|wall|floor|furniture|background|scenery|table|cloth|cable|shadow|reflection|"
    r"sliver|nothing)\b",
    re.IGNORECASE,
)


def _fill_empty(table: dict[Any, Any], words: dict[Any, Any]) -> dict[Any, Any]:
    return {**words, **{key: text for key, text in table.items() if key not in words or text not in (None, "")}}


class SegmentReply(Description):
    """A description in a reply about several segments; ``id`` is the segment's number."""

    id: Annotated[int | None, BeforeValidator(_read_segment_name)] = None

    @classmethod
    def fill_missing_words(cls, table: dict[Any, Any]) -> dict[Any, Any]:
        """Read words in place of ``is_object``, and fill in missing fields of a segment that is no object."""
        table = _fill_number(table)
        word = table.get("is_object")
        words = word.strip() if isinstance(word, str) else ""
        if _SEVERAL.match(words):
            filled = {"description": "several things", "color": "", "shape": "", "category": "objects"}
            return {**_fill_empty(table, filled), "is_object": True, "shows": "several"}
        if part := _PART.match(words):
            table = {**table, "is_object": False, "part_of": part[1]}
        elif scenery := _SCENERY.match(words):
            table = {"description": scenery[1].lower(), **table, "is_object": False, "shows": scenery[1].lower()}
        if str(table.get("is_object")).lower() not in ("false", "no", "0"):
            return table
        return _fill_empty(table, {"description": "no object", "color": "", "shape": "", "category": ""})


class SegmentReplies(ModelReply):
    """A reply about several segments under a single key, as a JSON schema needs it."""

    segments: tuple[SegmentReply, ...]


_MOST = 100
"""Entries of a list in a reply: more than the segments of any photo."""


def _read_group(value: Any) -> Any:
    """A list of segments, perhaps as the only list of an object."""
    if isinstance(value, dict):
        lists: list[Any] = [item for item in cast("dict[Any, Any]", value).values() if isinstance(item, list)]
        return cast(Any, lists[0] if len(lists) == 1 else value)
    return value


def _read_groups(value: Any) -> Any:
    """A list of groups; a list of segments is a single group."""
    items = cast("list[Any]", value) if isinstance(value, list) else []
    return [items] if items and not any(isinstance(item, list | dict) for item in items) else cast(Any, value)


SegmentNumber = Annotated[int, BeforeValidator(_read_segment_name), Field(ge=-(10**6), le=10**6)]
SegmentName = Annotated[
    Annotated[int, Field(ge=-(10**6), le=10**6)] | Annotated[str, Field(pattern=r"^\d{1,6}[a-z]$")],
    Field(union_mode="left_to_right"),
    BeforeValidator(_read_segment_name),
]
"""A segment's number, or the name of a part of a split segment: ``3b``."""
Label = Annotated[str, BeforeValidator(_shorten)]


class SegmentSplit(ModelReply):
    """A segment that shows several objects, with a box around each."""

    segment: SegmentNumber = Field(validation_alias=AliasChoices("segment", "id"))
    boxes: tuple[PictureBox, ...] = Field(min_length=1, max_length=30)


class SegmentDrop(ModelReply):
    """A segment that shows no object."""

    segment: SegmentName = Field(validation_alias=AliasChoices("segment", "id"))
    what: Label = ""

    @model_validator(mode="before")
    @classmethod
    def _read_bare_name(cls, value: Any) -> Any:
        return {"segment": value} if isinstance(value, int | str) else value


class MissingObject(ModelReply):
    """An object without a segment, or the rest of an object that a segment shows in part."""

    what: Label = ""
    box: PictureBox
    part_of: Annotated[SegmentName | None, BeforeValidator(_read_segment_name)] = None


class Grouping(ModelReply):
    """The grouper's reply: its corrections of a segmentation."""

    merge: Annotated[
        tuple[Annotated[tuple[SegmentName, ...], BeforeValidator(_read_group), Field(max_length=_MOST)], ...],
        BeforeValidator(_read_groups),
    ] = Field(max_length=_MOST)
    split: Annotated[tuple[SegmentSplit, ...], BeforeValidator(_read_items)] = Field(max_length=_MOST)
    drop: Annotated[tuple[SegmentDrop, ...], BeforeValidator(_read_items)] = Field(max_length=_MOST)
    missing: Annotated[tuple[MissingObject, ...], BeforeValidator(_read_items)] = Field(max_length=_MOST)

    @classmethod
    def fill_missing_words(cls, table: dict[Any, Any]) -> dict[Any, Any]:
        """A list that a reply leaves out is empty, unless it leaves out all."""
        known = {key: () if value is None else value for key, value in table.items() if key in cls.model_fields}
        return {**dict.fromkeys(cls.model_fields, ()), **known} if known else table

    def with_boxes(self, convert: Callable[[PictureBox], PictureBox]) -> "Grouping":
        """The reply with each box converted."""
        split = [item.model_copy(update={"boxes": tuple(map(convert, item.boxes))}) for item in self.split]
        missing = [item.model_copy(update={"box": convert(item.box)}) for item in self.missing]
        return self.model_copy(update={"split": tuple(split), "missing": tuple(missing)})


def _read_share(value: Any) -> Any:
    """``0.9`` of ``90``, ``"90 %"`` and ``"0.9"``; None for anything else that is no share."""
    try:
        number = float(value.strip().removesuffix("%") if isinstance(value, str) else value)
    except (TypeError, ValueError, OverflowError):
        return None
    return number if 0 <= number <= 1 else number / 100 if 1 < number <= 100 else None


class Match(ModelReply):
    """The matcher's reply about a candidate (paper, Scene Comprehension, step 3).

    ``asset`` names a library asset; ``no_asset`` is a real object that the library lacks; ``no_object`` is a
    segment that is not an object at all.
    """

    match: Literal["asset", "no_asset", "no_object"]
    asset: Annotated[str | None, BeforeValidator(_read_null_word)] = None
    confidence: Annotated[float | None, BeforeValidator(_read_share)] = None  # probability of the reply, 0..1
    reason: Word = ""


class SegmentMatch(Match):
    """A match in a reply about several segments; ``id`` is the segment's number."""

    id: Annotated[int | None, BeforeValidator(_read_segment_name)] = None

    @classmethod
    def fill_missing_words(cls, table: dict[Any, Any]) -> dict[Any, Any]:
        """A reply that names an asset without a verdict means the asset."""
        named = isinstance(table.get("asset"), str) and _read_null_word(table["asset"]) is not None
        return {"match": "asset", **_fill_number(table)} if named else _fill_number(table)


class SegmentMatches(ModelReply):
    """A reply about several segments under a single key, as a JSON schema needs it."""

    segments: tuple[SegmentMatch, ...]


def _read_asset_names(value: Any) -> Any:
    """The names in a list of objects, or in a text with commas."""
    if isinstance(value, str):
        return [name for part in value.split(",") if (name := part.strip())]
    if not isinstance(value, list):
        return value
    items = cast("list[Any]", value)
    tables = [cast("dict[Any, Any]", item) if isinstance(item, dict) else {} for item in items]
    return [table.get("asset", table.get("name", item)) for item, table in zip(items, tables, strict=True)]


class TaskDefinition(ModelReply):
    """The paper's three fields, with its spelling in JSON."""

    model_config = ConfigDict(serialize_by_alias=True)

    name: str = Field(alias="task-name", min_length=1, max_length=100)
    description: str = Field(alias="task-description", min_length=1)
    assets: Annotated[tuple[str, ...], BeforeValidator(_read_asset_names)] = Field(alias="assets-used", min_length=1)

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


NOTHING_GIVEN_UP = "nothing was given up"


def _read_given_up(value: Any) -> Any:
    return value.strip() or NOTHING_GIVEN_UP if isinstance(value, str) else NOTHING_GIVEN_UP if value is None else value


class TaskRevision(TaskDefinition):
    """A revised task, after the original could not be done or understood, and the part that was given up."""

    given_up: Annotated[str, BeforeValidator(_read_given_up)] = Field(
        default=NOTHING_GIVEN_UP, alias="given-up", max_length=500
    )

    def as_definition(self) -> TaskDefinition:
        """The task alone."""
        return TaskDefinition.model_validate(self.as_json())


class RouterReply(ModelReply):
    """The router's explanation and verdict, in the order in which a model decides."""

    explanation: Word = ""
    verdict: Annotated[Verdict, BeforeValidator(lambda value: "fix_test" if value == "fix_tests" else value)]


_JUDGEMENTS: Mapping[str, str] = {
    **dict.fromkeys(("agree", "agreed", "agreement"), "agrees"),
    **dict.fromkeys(("differ", "different", "disagree", "disagrees"), "differs"),
    **dict.fromkeys(("unsure", "ambiguous", "notjudged"), "unclear"),
}


def _read_judgement(value: Any) -> Any:
    return _JUDGEMENTS.get(_letters(value), value) if isinstance(value, str) else value


class WordsJudgement(ModelReply):
    """The judge's reason and verdict on the agreement of a task's words with its goals, in the order of decision."""

    reason: str = Field(min_length=1)
    # ``unclear``: the judge does not understand the words, or they are ambiguous
    verdict: Annotated[Literal["agrees", "differs", "unclear"], BeforeValidator(_read_judgement)]

    @classmethod
    def fill_missing_words(cls, table: dict[Any, Any]) -> dict[Any, Any]:
        """Read a reason under the name that the router's reply has for it."""
        return {"reason": table["explanation"], **table} if "explanation" in table else table


class NoReply(Frozen):
    """A role whose model gave no usable reply: an outcome, not an exception."""

    role: str
    tries: int  # number of refused replies
    problem: str  # of the last reply

    def __str__(self) -> str:
        return f"the {self.role} model gave no usable reply in {self.tries} tries: {self.problem}"
