"""Probes of a test program, from within the environment that it resets: comparison of scenes, and injected faults.

A ``Probe`` is called at each ``env.reset`` of this process. It draws the scene of the same seed every time, compares it
with the audited task instance, and may replace it by a mutant: a suite with teeth then fails.
"""

import random
from collections.abc import Callable
from typing import Any, Final, cast

import numpy as np

from grs_agents.base import Pose
from grs_agents.base.mujoco_import import mujoco
from grs_agents.sim.cliport.environment import Environment
from grs_agents.sim.cliport.instantiation import describe_instance
from grs_agents.sim.cliport.task import Task
from grs_agents.sim.end_effectors import END_EFFECTORS, TwoFingers
from grs_agents.sim.expert.oracle import Oracle
from grs_agents.sim.goals.scores import MET
from grs_agents.sim.goals.strict_score import StrictScorer
from grs_agents.sim.instance.episode import SimulationError, Stop, set_last_recorder
from grs_agents.sim.instance.task_instance import TaskInstance
from grs_agents.sim.motion.pick_place import PickPlaceResult
from grs_agents.sim.tabletop_episode import TabletopEpisode

_HANDS: Final = (*END_EFFECTORS.values(), TwoFingers)
_TRUSTED: Final = tuple(
    kind
    for kind in (*Environment.__mro__, *Task.__mro__, *Oracle.__mro__, TabletopEpisode, *_HANDS)
    if kind.__module__.startswith("grs_agents.")
)
"""The classes that tests must leave as they are."""
_STATE: Final = mujoco.mjtState.mjSTATE_INTEGRATION
_MOST_STATES: Final = 32
"""Most states kept, least recently used dropped; each takes up to 16 MB. Episodes rarely have half as many actions."""
Action = dict[str, Pose]
PickAndPlace = Callable[[Pose, Pose], PickPlaceResult]
_COMPARED: Final = ("max_steps", "timestep", "primitive", "sixdof", "pos_eps", "rot_eps", "ties", "goals")
"""Fields of two instances that must be equal, besides their objects: they decide how an episode goes."""
_NAMED_LATER: Final = {"mass": None, "friction": None, "name": "", "added": False}
"""Fields that trusted code adds to the objects of a program, with the values that they have without."""


class EpisodeMemory:
    """Cache of the oracle's decisions and of actions' results, by the exact state before: both are deterministic.

    Several tests that run the same episode then cost one episode, and mutants share the actions before the first that
    differs. An oracle that leaves a path in memory decides afresh.
    """

    def __init__(self) -> None:
        self._decisions: dict[Any, tuple[Action | None, Stop | None]] = {}
        self.packings: dict[Any, Any] = {}
        self._actions: dict[Any, tuple[PickPlaceResult, Any, int]] = {}  # most recently used last

    def run_or_replay_action(self, env: Environment, pick: Pose, place: Pose, act: PickAndPlace) -> PickPlaceResult:
        """Result of ``act(pick, place)``, which is carried out or replayed."""
        physics = env.physics
        if physics.held_object_id is not None or physics.observer is not None:
            return act(pick, place)
        key = (_make_scene_key(env), pick, place)
        if key in self._actions:
            result, state, steps = self._actions[key] = self._actions.pop(key)
            physics.budget.spend_steps(steps)
            physics.restore_state(state)
            return result
        before = physics.budget.left
        result = act(pick, place)
        if physics.held_object_id is None:
            if len(self._actions) >= _MOST_STATES:
                del self._actions[next(iter(self._actions))]
            self._actions[key] = (result, physics.save_state(), before - physics.budget.left)
        return result

    def memoize_decision(self, trail: Any, env: Environment, decide: Callable[[], Action | None]) -> Action | None:
        """Result of ``decide()`` for a scene with a ``trail`` (hash) of earlier scenes, called or recalled."""
        if trail not in self._decisions:
            self._decisions[trail] = (decide(), env.recorder.stop)
        decision, env.recorder.stop = self._decisions[trail]
        set_last_recorder(env.recorder)
        return decision


class RememberingOracle(Oracle):
    """An oracle whose decisions are cached."""

    def __init__(self, oracle: Oracle, env: Environment, memory: EpisodeMemory) -> None:
        super().__init__(oracle.task, env)
        self._oracle, self._env, self._memory = oracle, env, memory
        oracle.packings = memory.packings
        self._recorder: Any = None
        self._trail = 0

    def act(self, obs: Any = None, info: Any = None) -> Action | None:
        """The next action, as the oracle decides or has decided before."""
        del obs, info
        env, task = self._env, cast(Any, self._env.task)
        if self._recorder is not env.recorder:
            self._recorder, self._trail = env.recorder, hash((repr(task.grs.stated), task.pos_eps, task.rot_eps))
        self._trail = hash((self._trail, _make_scene_key(env), len(task.goals), len(env.recorder.actions)))
        return self._memory.memoize_decision(self._trail, env, self._oracle.act)


def _make_scene_key(env: Environment) -> tuple[Any, ...]:
    """Key of everything that decides the result of an action: compiled world, objects' poses and full state."""
    objects = [(item.id, item.asset, repr(item.fill), item.category, item.pose) for item in env.objects]
    model, data = env.physics.model, env.physics.data
    state = np.empty(mujoco.mj_stateSize(model, _STATE))
    mujoco.mj_getState(model, data, state, _STATE)
    return (
        env.timestep,
        env.hand,
        env.end_effector.tool,
        env.background,
        repr(env.object_ties),
        *objects,
        state.tobytes(),
    )


class EpisodeReplay:
    """Witness that replays episodes of this process from memory."""

    def __init__(self, memory: EpisodeMemory) -> None:
        self.memory = memory

    def begin_reset(self, env: Environment) -> None:
        """A reset begins."""

    def finish_reset(self, env: Environment) -> None:
        """The program has set its scene up."""

    def run_or_replay_action(self, env: Environment, pick: Pose, place: Pose, act: PickAndPlace) -> PickPlaceResult:
        """Carry out an action, or replay it."""
        return self.memory.run_or_replay_action(env, pick, place, act)

    def finish_step(self, env: Environment) -> None:
        """An action was scored."""

    def watch_oracle(self, oracle: Oracle, env: Environment) -> Oracle:
        """The oracle with its decisions cached."""
        return RememberingOracle(oracle, env, self.memory)


class Probe(EpisodeReplay):
    """Witness of a run of a test suite.

    Args:
        instance: the task instance that was audited, of the seed that the run draws.
        mutant: instance that replaces it on the table; None for none.
        coin: seeds the tests' random numbers, so that a suite that gambles is found out.
        early: seed before the first reset of a test too, not only after it; a program that draws before its reset,
            e.g. in ``__init__``, then sets another scene up.
        memory: of episodes, shared by the runs of one process.
        undo: put all objects back once the goals are met: the reward is earned, and nothing is done.
    """

    def __init__(
        self,
        instance: TaskInstance,
        mutant: TaskInstance | None,
        coin: int,
        early: bool,
        memory: EpisodeMemory,
        undo: bool = False,
    ) -> None:
        super().__init__(memory)
        self.instance, self.mutant, self.coin, self.early, self.undo = instance, mutant, coin, early, undo
        self.solved = 0  # episodes of the audited instance at full reward
        self.difference = ""  # difference of the last scene from the audited instance
        self.replaced = ""  # a method of the runtime that the tests replaced
        self.held: list[bool] = []  # for each episode: whether the audited instance's goals hold at its end
        self._parts = [(kind, _own_methods_by_name(kind)) for kind in _TRUSTED]
        self._drawn: tuple[Any, Any] | None = None
        self._rng: tuple[Environment, Any] | None = None
        self._env: Environment | None = None

    def begin_test(self) -> None:
        """A test begins; the global generators were just seeded."""
        self.end_episode()
        self._drawn, self._rng = None, None
        if self.early:
            self._drawn = (random.getstate(), np.random.get_state())
            self._seed_global_generators()

    def begin_reset(self, env: Environment) -> None:
        """A reset begins. Later resets of a test draw the same scene as its first."""
        self.end_episode()
        if self._drawn is None:
            self._drawn = (random.getstate(), np.random.get_state())
        random.setstate(self._drawn[0])
        np.random.set_state(self._drawn[1])
        if self._rng is None or self._rng[0] is not env:
            self._rng = (env, env.rng.bit_generator.state)
        env.rng.bit_generator.state = self._rng[1]

    def _seed_global_generators(self) -> None:
        random.seed(self.coin)
        np.random.seed(self.coin)

    def finish_reset(self, env: Environment) -> None:
        """The program has set its scene up: compare it with the audited instance, and replace it by the mutant."""
        self._seed_global_generators()
        self._env = env
        task: Any = env.task
        try:
            drawn = describe_instance(env, cast(Task, task), self.instance.seed)
        except (AttributeError, TypeError, ValueError, SimulationError):
            self.difference = "it is no task instance"
            return
        found = {item.id: item for item in drawn.task_objects}
        audited = {item.id: item.model_copy(update=_NAMED_LATER) for item in self.instance.task_objects}
        fields = [name for name in _COMPARED if getattr(drawn, name) != getattr(self.instance, name)]
        self.difference = ", ".join(["objects"] * (found != audited) + fields)
        if self.mutant is None or self.difference:
            return
        before = {item.id: item for item in self.instance.objects}
        for item in self.mutant.objects:
            if item != before[item.id]:
                env.replace_object(item)
        program_goals = tuple(task.goals)
        task.goals = list(self.mutant.goals)
        task.lang_goals = [goal.language for goal in self.mutant.goals]
        task.grs.finish_reset(env)
        task.grs.told = program_goals  # tests are to look at the table, not to compare the words of goals

    def finish_step(self, env: Environment) -> None:
        """An action was scored: undo all actions if it met the last goal and this run is to undo."""
        task: Any = env.task
        if not self.undo or task.goals:
            return
        for number in dict.fromkeys(number for goal in task.grs.stated for number in goal.objects):
            if number in env.places and env.is_object_movable(number):
                env.set_object_pose(number, env.places[number])

    def end_episode(self) -> None:
        """Evaluate the present episode while its scene stands."""
        env, self._env = self._env, None
        self.replaced = self.replaced or self._find_replaced_method(env)
        if env is None or not env.recorder.actions or self.difference or self.undo:
            return
        task: Any = env.task
        if self.mutant is None:
            episode = env.current_episode
            self.solved += episode.outcome == "success" and episode.strict >= MET
        else:
            task.grs.stated = tuple(self.instance.goals)
            self.held.append(StrictScorer(task, env).measure_scene().strict >= MET)

    def finish_and_report(self) -> dict[str, Any]:
        """Results of the run, as JSON."""
        self.end_episode()
        held = bool(self.held) and all(self.held)
        return {"solved": self.solved, "difference": self.difference, "replaced": self.replaced, "held": held}

    def _find_replaced_method(self, env: Environment | None) -> str:
        """First replaced method of the runtime, of a class, of this environment or of its task; "" for none."""
        for kind, parts in self._parts:
            now = _own_methods_by_name(kind)
            if changed := [name for name in {**parts, **now} if now.get(name) is not parts.get(name)]:
                return f"{kind.__name__}.{changed[0]}"
        if env is not None and type(env.end_effector) not in _HANDS:
            return "Environment.end_effector"
        for instance in (env, env.task, env.end_effector) if env is not None else ():
            kind = type(instance)
            if hidden := [name for name in vars(instance) if callable(getattr(kind, name, None))]:
                return f"{kind.__name__}.{hidden[0]}"
        return ""


def _own_methods_by_name(kind: type) -> dict[str, Any]:
    return {
        name: part for name, part in vars(kind).items() if callable(part) or isinstance(part, property | classmethod)
    }
