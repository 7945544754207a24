"""Records of an episode: a typed outcome, and a sentence on its cause with names and numbers."""

import re
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, Final, Literal

from grs_agents.base import Frozen, Vec3
from grs_agents.base.errors import GrsError
from grs_agents.sim.goals.scores import MET, SOLVED

Outcome = Literal[
    "success",
    "stopped",
    "partial",
    "step_limit",
    "unreachable",
    "hindered",
    "no_seal",
    "would_tip",
    "no_grip",
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


_WELL: Final = ("placed", "pushed")
"""Notes of successful primitives."""
_LOST: Final = re.compile(r"(?:(?:tipped|slipped) off the cup|slipped from between the fingers)(?!.* as it hit )")
"""Notes of actions in which the hand lost an object by its weight alone."""


class SimulationError(GrsError):
    """A simulation program asked for the impossible; ``outcome`` types the reason."""

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
    """A value that no task instance may have: a position out of bounds, a number that is not finite."""


class UnsupportedError(SimulationError):
    """The program asks for physics that this runtime lacks."""


class ActionRecord(Frozen):
    """A pick-and-place, or a push."""

    object: int | None  # id of the object picked, or pushed the farthest
    asset: str
    pick: Vec3  # positions of the action's two poses, metres
    place: Vec3
    reward: float
    note: str  # report of the primitive, e.g. "placed" or "nothing to grasp at (0.50, 0.10, 0.02)"
    trouble: Outcome | None = None  # kind of the failure in the note; None on success, or if it has no name
    pushed: tuple[int, ...] = ()  # ids of the objects that a push moved, farthest first


class GoalOutcome(Frozen):
    """State of a goal."""

    goal: str  # a line on its kind, the objects by asset name and id, its target in numbers
    worth: float  # its share of the reward
    published: float  # 0..1, share of its worth that it earned; open goals after the first earn nothing
    strict: float  # 0..1, score of the scene as it stands; an object that a later goal has moved on counts
    shortfalls: tuple[str, ...] = ()  # for each object that misses: its name, and its deviation in numbers

    @property
    def met(self) -> bool:
        """Whether it holds strictly, for all of its objects."""
        return self.strict >= MET


class ObjectMotion(Frozen):
    """Start of an object, once the scene had settled, and its current position."""

    object: int
    asset: str
    start: Vec3  # metres
    end: Vec3
    tilt: float  # degrees of tilt gained since the start, negative if it lost some; 0 for balls
    moved: bool  # it is more than 2 cm or 15 degrees away from its start
    extent: tuple[float, float] = (0.0, 0.0)  # along x and y at its start, metres
    color: str = ""  # nearest name in `utils.COLORS`, if the program painted it


class Episode(Frozen):
    """Result of an episode."""

    outcome: Outcome
    reward: float  # 0..1, as published: height and tilt do not count, a goal once met stays met
    strict: float = 0.0  # 0..1, every goal judged on the scene at the end; knocked over objects lower it
    weakest: float = 0.0  # strict score of the goal that holds least; 0 where something else was knocked over
    steps: int
    max_steps: int
    detail: str  # a sentence with names, numbers and bounds
    objects: tuple[str, ...] = ()  # asset names concerned
    actions: tuple[ActionRecord, ...] = ()
    shortfalls: tuple[str, ...] = ()  # a clause on each object that lowers the strict score
    goals: tuple[GoalOutcome, ...] = ()  # in the order in which the program states them
    motions: tuple[ObjectMotion, ...] = ()  # of every object
    warnings: tuple[str, ...] = ()  # parts of the program without effect, and corrections

    @property
    def arm_failure(self) -> tuple[str, str]:
        """Asset that the hand cannot hold, by its weight or shape, and the evidence; both empty without one."""
        if self.outcome in ("no_seal", "would_tip", "no_grip"):
            return "".join(self.objects[:1]), self.detail
        lost = [action for action in self.actions if _LOST.search(action.note)]
        return (lost[-1].asset, lost[-1].note) if lost and self.outcome not in ("success", "stopped") else ("", "")

    @property
    def cause(self) -> str:
        """Physical reason why goals do not hold, a clause with names and numbers; empty if they hold."""
        trouble = next((action.note for action in reversed(self.actions) if action.note not in _WELL), "")
        missed = "; ".join(self.shortfalls[:2])
        if self.outcome == "success":
            return missed
        if self.outcome == "step_limit":
            return f"{trouble or missed or self.detail}; all {self.max_steps} actions are used"
        if self.outcome in ("partial", "stopped"):  # no failure with a name of its own
            return trouble or f"{missed or 'goals are not met'}, after {self.steps} of {self.max_steps} actions"
        # A giving-up sentence names the place first and quotes the last trouble.
        return trouble if trouble and trouble in self.detail else self.detail


@dataclass(frozen=True)
class EndState:
    """Measured state of an episode's scene."""

    reward: float = 0.0
    complete: bool = False  # every goal was met at some time
    strict: float = 0.0
    weakest: float = 0.0
    shortfalls: tuple[str, ...] = ()
    goals: tuple[GoalOutcome, ...] = ()
    motions: tuple[ObjectMotion, ...] = ()
    placed: int = 0  # objects that meet the last goal that names them
    wanted: int = 0  # objects that goals name


@dataclass(frozen=True)
class Stop:
    """The reason why the oracle has no further action."""

    outcome: Outcome
    detail: str
    objects: tuple[str, ...] = ()


def make_stop_from_error(error: GrsError) -> Stop:
    """An error as the end of an episode."""
    return Stop(error.outcome if isinstance(error, SimulationError) else "error", str(error))


@dataclass
class Recorder:
    """Records the current episode of an environment."""

    max_steps: int = 0
    actions: list[ActionRecord] = field(default_factory=list[ActionRecord])
    warnings: list[str] = field(default_factory=list[str])
    stop: Stop | None = None
    measure: Callable[[], EndState] | None = None  # measures the scene while it exists
    end: EndState = EndState()  # as last measured

    @property
    def has_any_action(self) -> bool:
        """Whether anything acted or stopped, beyond setting up the scene."""
        return bool(self.actions) or self.stop is not None

    def freeze(self) -> None:
        """Measure for the last time, before the scene is cleared."""
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
        end, steps = self.end, len(self.actions)
        score = f"{end.placed} of {end.wanted} objects are at their goals after {steps} of max_steps={self.max_steps}, "
        score += f"reward {end.reward:.2f}, strict score {end.strict:.2f}"
        if end.reward > SOLVED and not end.complete:
            score += ", done by the published rule"
        if end.complete:
            held = "every goal met"
            if end.shortfalls:
                kept = end.placed == end.wanted
                held = "every goal met, yet" if kept else "every goal was met once, not all hold at the end:"
                held += f" {'; '.join(end.shortfalls[:3])}{'; ...' if len(end.shortfalls) > 3 else ''}"
            return Stop("success", f"{held}: {score}")
        if self.stop is not None and self.stop.outcome != "partial":
            return self.stop
        troubles = [action for action in self.actions if action.note not in _WELL]
        names = tuple(dict.fromkeys(action.asset for action in troubles if action.asset))
        last = f"; last trouble: {troubles[-1].note}" if troubles else ""
        if self.max_steps and steps >= self.max_steps:
            return Stop("step_limit", f"step limit: {score}{last}", names)
        if self.stop is not None:
            return self.stop
        return Stop("stopped", f"stopped by the caller: {score}{last}", names)


_latest: list[Recorder] = []


def set_last_recorder(recorder: Recorder) -> None:
    """Make ``last_episode`` read ``recorder``, once anything acts in it."""
    _latest[:] = [*[other for other in _latest if other.has_any_action and other is not recorder][-1:], recorder]


def last_episode() -> dict[str, Any] | None:
    """Last episode in this process with any action or error, as JSON; None without any."""
    played = [recorder for recorder in _latest if recorder.has_any_action]
    return played[-1].build_episode().model_dump(mode="json") if played else None


def clear_last_episode() -> None:
    """Forget the last episode, e.g. before the next test."""
    _latest.clear()
