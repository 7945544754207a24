"""What came of an episode: a typed outcome, and one sentence that says why with names and numbers."""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, Final, Literal

from grs_agents.base import Frozen, Vec3
from grs_agents.base.errors import GrsError

Outcome = Literal[
    "success",
    "stopped",
    "partial",
    "step_limit",
    "unreachable",
    "hindered",
    "no_seal",
    "would_tip",
    "dropped",
    "toppled",
    "target_occupied",
    "target_too_small",
    "no_free_space",
    "nothing_to_do",
    "simulated_step_limit",
    "object_limit",
    "vertex_limit",
    "error",
]


_WHOLE: Final = 0.985
"""Strict score from which on all of a goal counts as met."""
_WELL: Final = ("placed", "pushed")
"""What primitives report when all went well."""


class SimulationError(GrsError):
    """A simulation program asked for something that cannot be; ``outcome`` types the reason."""

    outcome: Outcome = "error"


class NoFreeSpaceError(SimulationError):
    """No pose was free, or an object was added at a pose of None."""

    outcome: Outcome = "no_free_space"


class SimulationBudgetError(SimulationError):
    """The environment, or the call, used up its simulated steps."""

    outcome: Outcome = "simulated_step_limit"


class ObjectLimitError(SimulationError):
    """More objects on the table than a call allows."""

    outcome: Outcome = "object_limit"


class VertexLimitError(SimulationError):
    """Meshes with more vertices on the table than a call allows."""

    outcome: Outcome = "vertex_limit"


class InvalidValueError(SimulationError):
    """A value that no task instance may have: a place out of bounds, a number that is none."""


class UnsupportedError(SimulationError):
    """The program asks for physics that this runtime does not have yet."""


class ActionRecord(Frozen):
    """One pick-and-place, or one push."""

    object: int | None  # what was picked, or was pushed the farthest
    asset: str
    pick: Vec3  # positions of the action's two poses, metres
    place: Vec3
    reward: float
    note: str  # what the primitive reports, e.g. "placed" or "nothing to grasp at (0.50, 0.10, 0.02)"
    trouble: Outcome | None = None  # what kind of failure the note tells; None where all went well, or of no kind
    pushed: tuple[int, ...] = ()  # ids of everything that a push moved, farthest first


class GoalOutcome(Frozen):
    """How one goal stands."""

    goal: str  # one line: its kind, the objects by asset name and id, its target in numbers
    worth: float  # its share of the reward
    published: float  # 0..1, what it earned of that share; the open goals after the first one earn nothing
    strict: float  # 0..1, how far it holds as the scene stands; an object that a later goal has moved on counts
    shortfalls: tuple[str, ...] = ()  # for each object that misses: its name, and how it does in numbers

    @property
    def met(self) -> bool:
        """Whether it holds strictly, for all of its objects."""
        return self.strict >= _WHOLE


class ObjectMotion(Frozen):
    """Where an object began, once the scene had settled, and where it is."""

    object: int
    asset: str
    start: Vec3  # metres
    end: Vec3
    tilt: float  # degrees that it is more tilted than at the start, less than 0 if it is less so; 0 for balls
    moved: bool  # it is more than 2 cm or 15 degrees away from its start


class Episode(Frozen):
    """How an episode ended."""

    outcome: Outcome
    reward: float  # 0..1, as published: height and tilt do not count, what was once met stays met
    strict: float = 0.0  # 0..1, every goal judged on the scene at the end; knocked over objects lower it
    weakest: float = 0.0  # strict score of the goal that holds least; 0 where something else was knocked over
    steps: int
    max_steps: int
    detail: str  # one sentence with names, numbers and bounds
    objects: tuple[str, ...] = ()  # asset names concerned
    actions: tuple[ActionRecord, ...] = ()
    shortfalls: tuple[str, ...] = ()  # for each object that the strict score misses, one clause that says why
    goals: tuple[GoalOutcome, ...] = ()  # in the order in which the program states them
    motions: tuple[ObjectMotion, ...] = ()  # of every object
    warnings: tuple[str, ...] = ()  # what of the program had no effect, or was corrected

    @property
    def cause(self) -> str:
        """The physical reason for which goals do not hold, one clause with names and numbers; empty where they hold."""
        trouble = next((action.note for action in reversed(self.actions) if action.note not in _WELL), "")
        missed = "; ".join(self.shortfalls[:2])
        if self.outcome == "success":
            return missed
        if self.outcome == "step_limit":
            return f"{trouble or missed or self.detail}; all {self.max_steps} actions are used"
        if self.outcome in ("partial", "stopped"):  # nothing stopped the robot that has a name
            return trouble or f"{missed or 'goals are not met'}, after {self.steps} of {self.max_steps} actions"
        # A giving-up sentence names the place first and quotes the last trouble.
        return trouble if trouble and trouble in self.detail else self.detail


@dataclass(frozen=True)
class EndState:
    """How the scene of an episode stands, measured."""

    reward: float = 0.0
    complete: bool = False  # every goal was met at some time
    strict: float = 0.0
    weakest: float = 0.0
    shortfalls: tuple[str, ...] = ()
    goals: tuple[GoalOutcome, ...] = ()
    motions: tuple[ObjectMotion, ...] = ()
    placed: int = 0  # objects that are where the last goal that speaks of them wants them
    wanted: int = 0  # objects that goals speak of


@dataclass(frozen=True)
class Stop:
    """Why the oracle has no further action."""

    outcome: Outcome
    detail: str
    objects: tuple[str, ...] = ()


def make_stop_from_error(error: GrsError) -> Stop:
    """An error as the end of an episode."""
    return Stop(error.outcome if isinstance(error, SimulationError) else "error", str(error))


@dataclass
class Recorder:
    """Gathers one environment's current episode."""

    max_steps: int = 0
    actions: list[ActionRecord] = field(default_factory=list[ActionRecord])
    warnings: list[str] = field(default_factory=list[str])
    stop: Stop | None = None
    measure: Callable[[], EndState] | None = None  # says how the scene stands, while it stands
    end: EndState = EndState()  # as last measured

    @property
    def has_any_action(self) -> bool:
        """Whether anything acted, or stopped, rather than only a scene being set up."""
        return bool(self.actions) or self.stop is not None

    def freeze(self) -> None:
        """Measure for the last time: the scene is about to be cleared away."""
        if self.has_any_action and self.measure is not None:
            self.end = self.measure()
        self.measure = None

    def build_episode(self) -> Episode:
        """The episode so far."""
        if self.measure is not None:
            self.end = self.measure()
        end, stop = self.end, self._determine_stop_reason()
        return Episode(
            outcome=stop.outcome,
            reward=round(end.reward, 9),
            strict=end.strict,
            weakest=end.weakest,
            steps=len(self.actions),
            max_steps=self.max_steps,
            detail=stop.detail,
            objects=stop.objects,
            actions=tuple(self.actions),
            shortfalls=end.shortfalls,
            goals=end.goals,
            motions=end.motions,
            warnings=tuple(self.warnings),
        )

    def _determine_stop_reason(self) -> Stop:
        end = self.end
        count = f"{end.placed} of {end.wanted} objects are at their goals after {len(self.actions)} of "
        score = f"{count}max_steps={self.max_steps}, reward {end.reward:.2f}, strict score {end.strict:.2f}"
        score += _note_end_by_published_rule(end)
        if end.complete:
            return Stop("success", f"{_describe_whether_goals_still_hold(end)}: {score}")
        if self.stop is not None and self.stop.outcome != "partial":
            return self.stop
        troubles = [action for action in self.actions if action.note not in _WELL]
        names = tuple(dict.fromkeys(action.asset for action in troubles if action.asset))
        last = f"; last trouble: {troubles[-1].note}" if troubles else ""
        if self.max_steps and len(self.actions) >= self.max_steps:
            return Stop("step_limit", f"step limit: {score}{last}", names)
        if self.stop is not None:
            return self.stop
        return Stop("stopped", f"stopped by the caller: {score}{last}", names)


_PUBLISHED_DONE: Final = 0.99
"""CLIPort ends an episode as done where the sum of its rewards passes this, whatever goals are left."""


def _note_end_by_published_rule(end: EndState) -> str:
    return ", done by the published rule" if end.reward > _PUBLISHED_DONE and not end.complete else ""


def _describe_whether_goals_still_hold(end: EndState) -> str:
    """Whether goals that were all met hold at the end, and what falls short if they do not."""
    if not end.shortfalls:
        return "every goal met"
    held = "every goal met, yet" if end.placed == end.wanted else "every goal was met once, not all hold at the end:"
    return f"{held} {'; '.join(end.shortfalls[:3])}{'; ...' if len(end.shortfalls) > 3 else ''}"


_latest: list[Recorder] = []


def set_last_recorder(recorder: Recorder) -> None:
    """Make ``recorder`` the one that ``last_episode`` reads, once anything acts in it."""
    _latest[:] = [*[other for other in _latest if other.has_any_action and other is not recorder][-1:], recorder]


def last_episode() -> dict[str, Any] | None:
    """The last episode in this process in which something acted, or that an error ended, as JSON; None without one."""
    played = [recorder for recorder in _latest if recorder.has_any_action]
    return played[-1].build_episode().model_dump(mode="json") if played else None


def clear_last_episode() -> None:
    """Forget the last episode, e.g. before the next test."""
    _latest.clear()
