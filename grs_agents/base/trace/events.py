"""The events of a run, a small type for each kind.

Every event carries ``version`` (of this vocabulary), ``sequence`` (its number in the run, from 0), ``time``
(seconds since 1970) and ``attempt`` (fixes made so far); :class:`grs_agents.base.trace.log.EventLog` fills in the last
three. File paths are relative to the run folder.

JSON values are safe to write as a single line, whatever a model or a program put into them.
"""

import math
from typing import Annotated, Any, Literal, TypeVar, cast

from pydantic import AfterValidator, BaseModel, BeforeValidator, ConfigDict, Field, TypeAdapter, model_validator
from pydantic_core import to_jsonable_python

from grs_agents.base import Frozen


def replace_surrogates(value: Any) -> Any:
    """``value`` with lone surrogates replaced if it is a string: UTF-8 cannot hold them, models do write them."""
    return value.encode("utf-8", "replace").decode("utf-8") if isinstance(value, str) else value


def _to_plain_python(value: Any) -> Any:
    """Numpy arrays and scalars as plain Python; any other value as its ``repr``."""
    convert = getattr(value, "tolist", None)
    return convert() if callable(convert) else repr(value)


def _encode_json_tree(value: Any) -> Any:
    if isinstance(value, dict):
        return {replace_surrogates(key): _encode_json_tree(item) for key, item in cast("dict[Any, Any]", value).items()}
    if isinstance(value, list | tuple):
        return [_encode_json_tree(item) for item in cast("list[Any]", value)]
    if isinstance(value, float) and not math.isfinite(value):
        return "NaN" if math.isnan(value) else "Infinity" if value > 0 else "-Infinity"
    return replace_surrogates(value)


def to_plain_json(value: Any) -> Any:
    """``value`` as plain JSON data: tuples become lists, paths and NaN strings, models and arrays their content."""
    # before, since pydantic refuses keys that are not UTF-8; after, for the content of models and arrays
    return _encode_json_tree(to_jsonable_python(_encode_json_tree(value), fallback=_to_plain_python))


def summarise_value(value: Any, depth: int = 2) -> Any:
    """Summarise ``value`` as plain JSON data; of long texts and lists, and of deep values, only the size is given."""
    value = to_plain_json(value)
    if isinstance(value, str) and ("\n" in value or len(value) > _LONG):
        return f"{len(value.splitlines())} lines, {len(value)} characters"
    if isinstance(value, list):
        items = cast("list[Any]", value)
        short = depth > 0 and (len(items) <= _FEW and not any(isinstance(item, list | dict) for item in items))
        return [summarise_value(item, 0) for item in items] if short else f"{len(items)} items"
    if isinstance(value, dict):
        fields = cast("dict[str, Any]", value)
        if depth == 0 or len(fields) > _MANY:
            return f"{len(fields)} fields"
        return {key: summarise_value(item, depth - 1) for key, item in fields.items()}
    return value


_LONG, _FEW, _MANY = 160, 4, 16
Text = Annotated[str, BeforeValidator(replace_surrogates)]
"""A string that UTF-8 can hold."""
_LONGEST_NAME = 200
"""Characters: a name is measured, drawn and repeated in each view; a model's or node's name has some 20."""


Name = Annotated[
    str,
    BeforeValidator(replace_surrogates),
    AfterValidator(lambda name: name if len(name) <= _LONGEST_NAME else f"{name[: _LONGEST_NAME - 1]}…"),
]
"""A name, cut if it is longer than any that GRS writes."""
JsonObject = Annotated[dict[str, Any], BeforeValidator(to_plain_json)]
"""A JSON object; equal to itself after a trip through a file."""


_WIDEST = 20_000
"""Largest width or height of a photo, pixels."""
_MOST_OBJECTS = 1_000
Number = Annotated[float, Field(allow_inf_nan=False, ge=-1e9, le=1e9)]
Vector = tuple[Number, Number, Number]
Turn = tuple[Number, Number, Number, Number]
Row = tuple[Number, Number, Number, Number]


class CheckedFields(BaseModel):
    """Types of the fields inside an event's free-form JSON that readers of the log rely on; other fields may be
    present."""

    model_config = ConfigDict(extra="allow", frozen=True)


class CheckedCamera(CheckedFields):
    """A pinhole camera: pixels, and the rigid transform from its frame to the robot's, if it is known."""

    fx: Annotated[float, Field(gt=0, le=1e6)]
    fy: Annotated[float, Field(gt=0, le=1e6)]
    cx: Number
    cy: Number
    width: Annotated[int, Field(ge=1, le=_WIDEST)]
    height: Annotated[int, Field(ge=1, le=_WIDEST)]
    depth_scale: Annotated[float, Field(gt=0, le=1e3)] | None = None
    T_robot_cam: tuple[Row, Row, Row, Row] | None = None


class CheckedBox(CheckedFields):
    """An axis-aligned box, metres, robot frame."""

    low: Vector
    high: Vector


class CheckedObject(CheckedFields):
    """An object of a scene; the pose is that of the centre of its asset, metres and xyzw, robot frame."""

    id: Annotated[int, Field(ge=0, le=100_000)] | None = None
    label: Annotated[int, Field(ge=0, le=100_000)] | None = None
    name: str | None = None
    asset: str | None = None
    description: str | None = None
    box: CheckedBox | None = None
    position: Vector | None = None
    orientation: Turn | None = None
    settled: tuple[Vector, Turn] | None = None


class CheckedSummary(CheckedFields):
    """The summary of a stage of the scene."""

    camera: CheckedCamera | None = None
    depth_scale: Annotated[float, Field(gt=0, le=1e3)] | None = None
    objects: Annotated[tuple[CheckedObject, ...], Field(max_length=_MOST_OBJECTS)] | None = None
    background: str | None = None


class CheckedEpisode(CheckedFields):
    """The oracle's episode of a test."""

    outcome: str | None = None
    detail: str | None = None


class CheckedCase(CheckedFields):
    """Result of a test."""

    id: str | None = None
    outcome: str | None = None
    message: str | None = None
    seconds: Number | None = None
    episode: CheckedEpisode | None = None


class CheckedReport(CheckedFields):
    """The report of a run of the tests."""

    outcome: str | None = None
    message: str | None = None
    seconds: Number | None = None
    cases: tuple[CheckedCase, ...] | None = None


_Json = TypeVar("_Json", bound=dict[str, Any])


def _validate_json_fields(value: _Json, kind: type[CheckedFields]) -> _Json:
    kind.model_validate(value)
    return value


VERSION = 5
"""Of this vocabulary: incremented whenever an older reader would misread a line."""


Count = Annotated[int, Field(ge=0, lt=2**53)]
"""Drawable by viewers: a whole number that a float holds exactly."""
MOST_TOTAL = 1e12
"""Bound of sums over a run, in seconds and US dollars."""
Seconds = Annotated[float, Field(ge=0, le=MOST_TOTAL, allow_inf_nan=False)]
MOST_COST = 1e6
Cost = Annotated[float, Field(ge=0, le=MOST_COST, allow_inf_nan=False)]
"""US dollars of a reply; a log of 250,000 values keeps below `MOST_TOTAL`."""
CostSource = Literal["provider", "prices", "unknown"]
"""Origin of a cost: the provider's answer, or the configured price of its tokens."""
Summary = Annotated[JsonObject, AfterValidator(lambda value: _validate_json_fields(value, CheckedSummary))]
Report = Annotated[JsonObject, AfterValidator(lambda value: _validate_json_fields(value, CheckedReport))]


class BaseEvent(Frozen):
    """Fields of all events."""

    version: int = VERSION
    sequence: int = Field(default=-1, ge=-1, lt=2**53, description="number in the run, from 0; -1 until it is in a log")
    time: Seconds = Field(default=0.0, description="seconds since 1970, UTC")
    attempt: Count = Field(default=0, description="number of fixes made before this")
    step: int | None = Field(default=None, description="the node_started event that it belongs to, by its sequence")


class RunStarted(BaseEvent):
    """A run begins or is resumed. ``nodes`` and ``edges`` are its state machine, if known."""

    kind: Literal["run_started"] = "run_started"
    run_id: Name
    graph: Name
    seed: int
    config: JsonObject = Field(default_factory=dict[str, Any])
    versions: dict[str, str] = Field(default_factory=dict[str, str])
    nodes: tuple[Name, ...] = ()
    edges: tuple[tuple[Name, Name], ...] = ()


class RunEnded(BaseEvent):
    """The run is over: accepted, rejected, failed or interrupted, and why."""

    kind: Literal["run_ended"] = "run_ended"
    status: Name
    reason: Text = ""


class NodeStarted(BaseEvent):
    """A node of the state machine begins its ``visit``-th visit (from 1)."""

    kind: Literal["node_started"] = "node_started"
    node: Name
    visit: Count = 1


class NodeEnded(BaseEvent):
    """A node is done: wall ``seconds``, the state fields it changed, and the error that ended it, if any.

    ``values`` summarises the new values of the fields; long values such as programs are in the node's other events.
    """

    kind: Literal["node_ended"] = "node_ended"
    node: Name
    seconds: Seconds
    changed: tuple[Name, ...] = ()
    values: JsonObject = Field(default_factory=dict[str, Any])
    error: Text = ""


class Prompt(BaseEvent):
    """A prompt of an agent to its model; ``call`` joins it to its :class:`Reply`.

    ``text`` is the last message; ``digest`` covers the whole conversation: 32 digits for the role, the words and the
    pictures' names, then 32 that also cover the numbers and the pixels.
    """

    kind: Literal["prompt"] = "prompt"
    call: Name
    role: Name
    model: Name
    text: Text
    images: tuple[str, ...] = ()
    digest: str = ""


class Reply(BaseEvent):
    """The model's answer; ``error`` is the reason why it could not be used, or why none arrived (``answered``).

    ``cached_tokens`` of the input were read from the provider's cache; ``cost`` is in US dollars, if ``cost_source``,
    the provider or the configured prices, gives it.
    """

    kind: Literal["reply"] = "reply"
    call: Name
    role: Name
    model: Name
    text: Text
    input_tokens: Count = 0
    output_tokens: Count = 0
    cached_tokens: Count = 0
    cost: Cost | None = None
    cost_source: CostSource = "unknown"
    seconds: Seconds = 0.0
    finish_reason: Name = ""
    error: Text = ""
    answered: bool = True


class ToolCall(BaseEvent):
    """A model called a tool: its ``arguments``, the ``result`` that the model received, and ``ok`` for success."""

    kind: Literal["tool_call"] = "tool_call"
    role: Name
    tool: Name
    arguments: JsonObject = Field(default_factory=dict[str, Any])
    result: Text = ""
    ok: bool = True
    seconds: Seconds = 0.0


class ProgramVersion(BaseEvent):
    """A version of a program: file ``path``, unified ``diff`` to ``parent``, and its author."""

    kind: Literal["program_version"] = "program_version"
    program: Literal["simulation", "tests"]
    number: Count
    sha256: str
    parent: str | None = None
    path: Text
    diff: Text = ""
    author_role: Name = ""
    source: Text = Field(default="", description="its origin, e.g. model or user")


class TestsRun(BaseEvent):
    """The test program ran: the sandbox's whole ``TestReport`` as JSON."""

    __test__ = False  # not a test class of pytest's
    kind: Literal["tests_run"] = "tests_run"
    report: Report


class Decision(BaseEvent):
    """The router's verdict, its policy and its reason."""

    kind: Literal["decision"] = "decision"
    verdict: Name
    explanation: Text = ""
    policy: Name = ""


class SceneStage(BaseEvent):
    """A stage of scene comprehension: numbers and names in ``summary``, pictures in ``files``.

    ``files`` may hold ``rgb``, ``depth`` (uint16 PNG), ``masks`` (label PNG, 0 = background), ``marks`` (the photo with
    its segments numbered, before they were regrouped), ``coverage`` (the photo with unowned pixels marked), ``twin``
    (the camera's view of the objects at rest, with their textures); ``summary`` may hold ``camera`` (fx, fy, cx, cy,
    width, height, depth_scale, T_robot_cam), ``depth_scale``, ``objects`` (id, name, box with low and high, in metres,
    robot frame) and ``coverage`` (share, unowned).
    """

    kind: Literal["scene_stage"] = "scene_stage"
    stage: Literal["frame", "segmented", "grouped", "background", "described", "matched"]
    summary: Summary = Field(default_factory=dict[str, Any])
    files: dict[str, str] = Field(default_factory=dict[str, str])


class TaskDefined(BaseEvent):
    """The task of the run: the paper's three fields as JSON."""

    kind: Literal["task_defined"] = "task_defined"
    task: JsonObject


class Rollout(BaseEvent):
    """The trusted oracle played a task instance; ``recording`` (.npz) and ``instance`` (.json) are files, ``cause`` is
    the reason why goals do not hold."""

    kind: Literal["rollout"] = "rollout"
    seed: int
    reward: Number
    outcome: Name
    steps: Count = 0
    moved: tuple[Name, ...] = ()
    idle_reward: Number = 0.0
    cause: Text = ""
    recording: str | None = None
    instance: str | None = None


class Finding(BaseEvent):
    """Outcome of a check of the audit: the measurement (``measured``) and the requirement (``bound``)."""

    kind: Literal["finding"] = "finding"
    check: Name
    passed: bool
    measured: Text = ""
    bound: Text = ""

    @model_validator(mode="before")
    @classmethod
    def _convert_version_3_fields(cls, values: Any) -> Any:
        """Up to version 3 a single text, ``detail``, held both."""
        if isinstance(values, dict) and "detail" in values:
            fields = cast("dict[str, Any]", values)
            return {"measured": fields["detail"], **{key: fields[key] for key in fields if key != "detail"}}
        return cast(Any, values)

    @property
    def detail(self) -> str:
        """Measurement and requirement in a line."""
        return f"{self.measured}; {self.bound}" if self.bound else self.measured


class Note(BaseEvent):
    """Further information for a reader."""

    kind: Literal["note"] = "note"
    level: Literal["info", "warning", "error"] = "info"
    text: Text


_Progress = RunStarted | RunEnded | NodeStarted | NodeEnded | Prompt | Reply | ToolCall
_Results = ProgramVersion | TestsRun | Decision | SceneStage | TaskDefined | Rollout | Finding | Note
Event = Annotated[_Progress | _Results, Field(discriminator="kind")]
"""Any event, discriminated by ``kind``."""
EVENT: TypeAdapter[Event] = TypeAdapter(Event)
"""Validates and serialises events: ``EVENT.validate_json(line)``."""


def event_schema() -> dict[str, Any]:
    """The JSON schema (2020-12) of a line of ``events.jsonl``."""
    named = {"$schema": "https://json-schema.org/draft/2020-12/schema", "title": f"GRS event, version {VERSION}"}
    return named | EVENT.json_schema(mode="serialization")
