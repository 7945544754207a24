"""The state that the graphs pass from node to node: texts, numbers and frozen records, checkpointed after each step."""

import operator
from collections.abc import Mapping, Sequence
from typing import Annotated, Any, Final, Literal, Self, TypedDict, cast, get_args, get_type_hints

from pydantic import Field, TypeAdapter, ValidationError

from grs_agents.agents.types import Description, TaskDefinition, Verdict
from grs_agents.audit.types import AuditReport, StaticFinding
from grs_agents.base import Frozen
from grs_agents.base.errors import InputError
from grs_agents.base.trace.events import to_plain_json
from grs_agents.graph.policies.types import EarlierDecision, RoutingDecision
from grs_agents.perception.edits import SceneEdits
from grs_agents.perception.types import (
    Camera,
    CandidateRecord,
    DroppedCandidate,
    MatchEvidence,
    SceneDescription,
    SceneObject,
    TableFrame,
)
from grs_agents.sandbox.protocol.report import TestReport

ProgramName = Literal["simulation", "tests"]
FixedName = Literal["simulation", "tests", "task"]
Strategy = Literal["fix", "rewrite"]
"""Mend the present version, or have its author write it anew."""
VERDICTS: Final[dict[FixedName, Verdict]] = {"simulation": "fix_code", "tests": "fix_test", "task": "fix_task"}


class TableObject(CandidateRecord):
    """A segment of the photo that may be an object. Each stage of perception fills one field."""

    description: Description | None = None  # stage describe
    match: MatchEvidence | None = None  # stage match; None for a segment described as no object
    placed: SceneObject | None = None  # stage register: its asset or proxy at a pose; None once dropped

    @classmethod
    def from_record(cls, record: CandidateRecord) -> Self:
        """A segment of which nothing else is known."""
        return cls(**dict(record))

    @property
    def described(self) -> Description:
        """The description; only after the stage describe."""
        assert self.description is not None
        return self.description

    @property
    def scene_object(self) -> SceneObject:
        """The entry of the scene; only of a placed object."""
        assert self.placed is not None
        return self.placed

    def place(self, **fields: object) -> Self:
        """The same object with other fields of its scene entry."""
        return self.model_copy(update={"placed": self.scene_object.model_copy(update=fields)})


def select_pending(objects: Sequence[TableObject], dropped: Sequence[DroppedCandidate]) -> list[TableObject]:
    """The objects that this pass of perception describes, matches and registers: neither placed nor dropped."""
    gone = {item.id for item in dropped}
    return [item for item in objects if item.placed is None and item.id not in gone]


class Draft(Frozen):
    """The program of an author that competes with another."""

    author: Literal["simulation", "rival"]  # the role whose model wrote it
    source: str = ""
    problem: str = ""  # why there is no program


class Revision(Frozen, serialize_by_alias=True):
    """The task before its revision, and the part of it that was given up."""

    original: TaskDefinition = Field(alias="from")
    given_up: str = Field(alias="given-up")


class Score(Frozen):
    """Quality of a pair of programs; the better of two has the greater ``rank``."""

    passed: int = 0  # tests
    tests: int = 0
    strict: float = 0.0  # of the oracle: the lowest over the audit's seeds, or else the highest in the tests
    held: int = 0  # checks of the audit
    checks: int = 0  # 0 where the audit did not run
    accepted: bool = False

    @property
    def rank(self) -> tuple[bool, float, float, float]:
        """The audit's verdict, the oracle's strict score, the shares of checks and of tests that hold."""
        return self.accepted, self.strict, self.held / max(1, self.checks), self.passed / max(1, self.tests)

    def __str__(self) -> str:
        audit = f", audit {self.held}/{self.checks} checks" if self.checks else ""
        return f"tests {self.passed}/{self.tests}, strict {self.strict:.2f}{audit}"


class FixRecord(Frozen):
    """A fix, with the score before and after it."""

    fixed: FixedName
    strategy: Strategy
    version: int  # of that program after the fix
    equals: int = 0  # the earlier version of that program that it equals; 0: none
    added: int  # lines
    removed: int
    problem: str = ""  # why the model's reply could not be used
    before: Score
    after: Score | None = None  # None until the programs were judged again
    evidence: str  # hash of the evidence that the fix was asked for with
    programs: str  # hash of task and programs before the fix
    assertions: tuple[str, ...] = ()  # of the tests: taken out (``- ...``) or put in their place (``+ ...``)
    vain: bool = False  # the evidence stayed as it was, or the programs were judged before

    @property
    def has_changed_lines(self) -> bool:
        """Whether anything was changed."""
        return bool(self.added or self.removed)

    def __str__(self) -> str:
        version = "written anew" if self.strategy == "rewrite" else f"version {self.version}"
        version += f", equal to version {self.equals}" if self.equals else ""
        change = f"{version} (+{self.added} -{self.removed} lines)" if self.has_changed_lines else "unchanged"
        outcome = f"{self.before} -> {self.after or 'not judged'}"
        return f"{VERDICTS[self.fixed]}: {self.problem or change}: {outcome}{'; in vain' if self.vain else ''}"


class JudgedVersion(Frozen):
    """Task and programs with their report and audit: the fields of the state that are restored together."""

    task: TaskDefinition
    revised: Revision | None = None
    simulation: str
    tests: str = ""  # empty in graphs without tests
    report: TestReport | None = None
    audit: AuditReport | None = None

    def as_update(self) -> dict[str, Any]:
        """Returns: the fields by name, to be merged into the state."""
        return dict(self)


class BestVersion(Frozen):
    """The best pair of programs so far."""

    score: Score
    simulation_version: int
    tests_version: int
    kept: JudgedVersion

    def describe(self) -> str:
        """Its versions and score, in words."""
        return f"program version {self.simulation_version} with tests version {self.tests_version} ({self.score})"


class RunState(TypedDict):
    """Pictures and recordings stay in files; the state holds their paths, relative to the run folder.

    A run begins with ``scene_path`` and ``max_fixes``; the edges of the graph order the nodes so that each finds its
    keys. Lists, not tuples, since a checkpoint gives lists back.
    """

    scene_path: str  # the scene: a folder, a file, or `bop:` and an image of a data set
    max_fixes: int  # bound on code and test fixes together
    notes: list[str]  # remarks on how the scene was read
    image: str  # the scene image that vision agents see; empty for graphs whose agents do not see it
    camera: Camera  # that took the photo
    table: TableFrame  # the table and the robot frame laid on it
    objects: list[TableObject]  # the segments that may be objects: placed, pending or dropped
    left_out: str  # mask file of pixels that are neither table nor candidate, such as the robot
    robot: str  # mask file of the pixels that are known to show the robot
    blur: str  # mask file of pixels beside candidates that have their depth, but not their colour
    dropped: list[DroppedCandidate]  # the segments that are no object, with the reasons
    background: str  # library name of the reconstructed background; empty if there is none
    edits: SceneEdits  # of a person; missing without any
    scene: SceneDescription
    task: TaskDefinition
    drafts: Annotated[list[Draft], operator.add]  # of authors that compete
    simulation: str  # source
    tests: str  # source
    simulation_version: int  # counts the versions of the program, from 1
    tests_version: int
    revisable: bool  # whether the task was defined in this run, and not revised yet
    revised: Revision | None
    static: list[StaticFinding]  # faults of the programs that show without a run
    report: TestReport  # of the latest tests
    decision: RoutingDecision  # the latest
    audit: AuditReport | None  # None from each fix until the next audit
    fixes: Annotated[int, operator.add]
    history: list[FixRecord]  # oldest first
    best: BestVersion
    routed: Annotated[list[EarlierDecision], operator.add]  # each decision, oldest first
    problem: str  # why the run cannot go on, if it cannot
    status: str  # `accepted` or `rejected` once it is known
    reason: str  # of the status


CHECKPOINTED_TYPES: Final[tuple[type[Frozen], ...]] = (
    Camera,
    TableFrame,
    TableObject,
    DroppedCandidate,
    SceneEdits,
    SceneDescription,
    TaskDefinition,
    Draft,
    Revision,
    StaticFinding,
    TestReport,
    RoutingDecision,
    AuditReport,
    FixRecord,
    BestVersion,
    EarlierDecision,
)
"""The only classes of GRS that are built from a checkpoint: those of the values of `RunState`."""
TYPED_KEYS: Final[dict[str, TypeAdapter[Any]]] = {
    key: TypeAdapter(hint)
    for key, hint in get_type_hints(RunState).items()
    if any(kind in CHECKPOINTED_TYPES for kind in (hint, *get_args(hint)))
}
"""The keys of `RunState` that hold records, with the validators of their types."""


_RESET: Final = ("revised", "audit")
"""Keys whose ``{}`` is the JSON of None; of other keys with records it says that there is none yet."""


def parse_state(values: Mapping[str, Any]) -> RunState:
    """Parse the records of a state that are plain JSON, as a request or a node of the user's may hold them.

    Raises:
        InputError: a value is not of the type that `RunState` names.
    """
    parsed = {key: value for key, value in values.items() if value != {} or key not in TYPED_KEYS or key in _RESET}
    for key in TYPED_KEYS.keys() & parsed.keys():
        try:
            parsed[key] = parse_state_value(key, parsed[key])
        except ValidationError as error:
            first = error.errors(include_url=False)[0]
            place = ".".join(map(str, (key, *first["loc"])))
            raise InputError(f"the state's {place}: {first['msg']}", "see grs_agents.graph.state.RunState") from error
    return cast(RunState, parsed)


def parse_state_value(key: str, value: Any) -> Any:
    """Parse the value of a key in ``TYPED_KEYS``; ``{}`` is the JSON of None. Raises ValidationError."""
    return TYPED_KEYS[key].validate_python(None if value == {} else value)


def state_as_json(values: Mapping[str, Any]) -> dict[str, Any]:
    """The state as plain JSON, as clients of LangGraph's server get it."""
    return {key: {} if value is None else to_plain_json(value) for key, value in values.items()}
