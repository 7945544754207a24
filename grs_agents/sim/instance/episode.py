"""What came of an episode: a typed outcome, and one sentence that says why with names and numbers."""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, Final, Literal

from grs_agents.base import Frozen, Vec3
from grs_agents.errors import GrsError

Outcome = Literal[
    "success",
    "stopped",
    "partial",
    "step_limit",
    "unreachable",
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
    pushed: tuple[int, ...] = ()  # ids of everything that a push moved, farthest first


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

    actions: list[ActionRecord] = field(default_factory=list[ActionRecord])
    stop: Stop | None = None
    reward: float = 0.0
    strict: float = 0.0
    weakest: float = 0.0
    shortfalls: tuple[str, ...] = ()
    max_steps: int = 0
    placed: int = 0
    wanted: int = 0
    complete: bool = False
    look: "Callable[[Recorder], None] | None" = None  # measures how the scene stands, when somebody wants to know

    def build_episode(self) -> Episode:
        """The episode so far."""
        if self.look is not None:
            self.look(self)
        stop = self._determine_stop_reason()
        return Episode(
            outcome=stop.outcome,
            reward=round(self.reward, 9),
            strict=self.strict,
            weakest=self.weakest,
            steps=len(self.actions),
            max_steps=self.max_steps,
            detail=stop.detail,
            objects=stop.objects,
            actions=tuple(self.actions),
            shortfalls=self.shortfalls,
        )

    def _determine_stop_reason(self) -> Stop:
        count = f"{self.placed} of {self.wanted} objects placed after {len(self.actions)} of max_steps={self.max_steps}"
        if self.complete:
            return Stop("success", f"every goal met: {count}, reward {self.reward:.2f}")
        if self.stop is not None and self.stop.outcome != "partial":
            return self.stop
        troubles = [action for action in self.actions if action.note not in _WELL]
        names = tuple(dict.fromkeys(action.asset for action in troubles if action.asset))
        last = f"; last trouble: {troubles[-1].note}" if troubles else ""
        if self.max_steps and len(self.actions) >= self.max_steps:
            return Stop("step_limit", f"step limit: {count}, reward {self.reward:.2f}{last}", names)
        if self.stop is not None:
            return self.stop
        return Stop("stopped", f"stopped by the caller: {count}, reward {self.reward:.2f}{last}", names)


_latest: list[Recorder] = []


def set_last_recorder(recorder: Recorder) -> None:
    """Make ``recorder`` the one that ``last_episode`` reads."""
    _latest[:] = [recorder]


def last_episode() -> dict[str, Any] | None:
    """The episode of the most recent environment in this process as JSON, or None."""
    return _latest[0].build_episode().model_dump(mode="json") if _latest else None


def clear_last_episode() -> None:
    """Forget the last episode, e.g. before the next test."""
    _latest.clear()
