"""Episodes on the simulated table: a task sets its scene up, actions follow, and each action is scored."""

from collections.abc import AsyncGenerator, Coroutine, Generator, Mapping
from typing import Any, Final, Generic, Protocol, TypeVar, cast

import numpy as np

from grs_agents.base import Pose
from grs_agents.base.errors import GrsError
from grs_agents.base.geometry.transforms import FloatArray
from grs_agents.library.library import Library
from grs_agents.sim.end_effectors import EndEffector, make_end_effector
from grs_agents.sim.expert.oracle import Oracle
from grs_agents.sim.expert.push_oracle import PushOracle
from grs_agents.sim.goals import task_accounting
from grs_agents.sim.goals.strict_score import StrictScorer
from grs_agents.sim.goals.task_accounting import TaskAccounting
from grs_agents.sim.instance.episode import (
    ActionRecord,
    GoalOutcome,
    Recorder,
    SimulationError,
    make_stop_from_error,
    set_last_recorder,
)
from grs_agents.sim.instance.goal import Goal
from grs_agents.sim.instance.task_instance import MOST_STEPS, POSITION_TOLERANCE, ROTATION_TOLERANCE, TaskInstance
from grs_agents.sim.rendering.cameras import VisibleScene
from grs_agents.sim.tabletop import TabletopSim, parse_pose
from grs_agents.sim.world.budget import DEFAULT_BUDGET

Action = Mapping[str, Any]
WAIT_STEPS: Final = 10
"""Time steps of a step without an action."""
PICKS: Final = 5
"""Tries of a hand that misses at one pick: on tops 3 cm wide, 2 of 3 misses by 5 mm find no seal."""
_MISSING_REWARD, _MISSING_SHARE = 0.01, 0.05
"""A goal is met when at most so much of the reward is missing, and at most this share of the goal."""


class GoalTask:
    """Goals met in their order, and the published reward for them.

    Attributes:
        max_steps: actions allowed.
        lang_template: sentence for goals without one.
        task_completed_desc: said at the end.
        sixdof: whether the tilt of a target is asked for.
        pos_eps, rot_eps: tolerance of ``pose`` goals, metres and radians.
        bounds, zone_bounds: (3, 2) lowest and highest x, y, z of the workspace, and of what counts as in a zone, m.
        goals: not met yet; lang_goals: a sentence for each of them.
        progress: reward of the goals that were met.
        grs: the runtime's own accounts.
    """

    def __init__(self) -> None:
        self.grs = TaskAccounting(self)
        self.max_steps = 10
        self.lang_template = ""
        self.task_completed_desc = "task completed."
        self.sixdof = False
        self.pos_eps = POSITION_TOLERANCE
        self.rot_eps = ROTATION_TOLERANCE
        self.bounds: FloatArray = np.array([[0.25, 0.75], [-0.5, 0.5], [0.0, 0.28]])
        self.zone_bounds: FloatArray = np.copy(self.bounds)
        self.goals: list[Goal] = []
        self.lang_goals: list[str] = []
        self.progress = 0.0

    def reset(self, env: Any) -> None:
        """Clear the goals; subclasses go on to add objects and goals."""
        self.grs.begin_reset(env)
        self.goals, self.lang_goals, self.progress = [], [], 0.0

    def finish_goals(self, env: Any) -> None:
        """Read the goals as they are stated when ``reset`` ends."""

    def reward(self) -> tuple[float, dict[str, Any]]:
        """Reward gained since the last call; goals that are met leave ``goals``."""
        partial = 0.0
        while self.goals:
            goal = self.goals[0]
            share = float(np.mean(self.grs.score_goal_objects(goal)))
            partial = goal.max_reward * share
            if 1 - share > min(_MISSING_REWARD / max(goal.max_reward, 1e-9), _MISSING_SHARE):
                break
            self.progress += goal.max_reward
            partial = 0.0
            self.goals.pop(0)
            if self.lang_goals:
                self.lang_goals.pop(0)
        before, self.grs.total = self.grs.total, min(1.0, self.progress + partial)
        return self.grs.total - before, {}

    def get_reward(self) -> float:
        """Reward gained since the reset, 0..1."""
        return float(self.grs.total)

    def done(self) -> bool:
        """Whether every goal is met."""
        return not self.goals and bool(self.grs.stated)

    def goals_met(self, env: Any) -> list[GoalOutcome]:
        """How each goal stands now, judged strictly, in the order of the goals.

        Each has ``met`` (bool), ``goal`` (what it asks for), ``strict`` (0..1) and ``shortfalls`` (for each object that
        misses, a clause with numbers). In a test::

            (x, y, z), _ = env.get_object_pose(env.find("HOPE/Milk.urdf")[0])
            for goal in task.goals_met(env):
                self.assertTrue(goal.met, goal)
        """
        if not env.places:
            raise SimulationError("task.goals_met before the scene has settled", "call env.reset() first")
        return self.grs.tell_goals(StrictScorer(self, env).measure_scene().goals)

    def is_match(self, pose0: Pose, pose1: Pose, symmetry: float) -> bool:
        """Whether two poses agree within ``pos_eps`` and ``rot_eps``."""
        return task_accounting.is_pose_at_target(pose0, pose1, symmetry, self.pos_eps, self.rot_eps)

    def get_lang_goal(self) -> str:
        """The current goal in words, or ``task_completed_desc``."""
        return self.lang_goals[0] if self.lang_goals else self.task_completed_desc

    def oracle(self, env: Any) -> Oracle:
        """An agent that solves the task: ``agent.act()`` gives the next action, or None when it stops."""
        return Oracle(self, env)


class InstanceTask(GoalTask):
    """The task of an instance.

    Attributes:
        instance: the instance.
        ids: id on the table of each of the instance's objects, by its id in the instance.
    """

    def __init__(self, instance: TaskInstance) -> None:
        super().__init__()
        self.instance = instance
        self.max_steps, self.sixdof = instance.max_steps, instance.sixdof
        self.pos_eps, self.rot_eps = instance.pos_eps, instance.rot_eps
        self.ids: dict[int, int] = {}

    @property
    def end_effector(self) -> EndEffector:
        """Hand that carries out the instance's actions."""
        return make_end_effector(self.instance.primitive, self.instance.hand)

    def reset(self, env: TabletopSim) -> None:
        """Add the instance's objects, ties and goals."""
        super().reset(env)
        env.background = self.instance.background
        ids = self.ids = {item.id: env.insert_object(item) for item in self.instance.objects}
        for tie in self.instance.ties:
            env.tie_objects(tie.model_copy(update={"parent": ids[tie.parent], "child": ids[tie.child]}))
        for goal in self.instance.goals:
            relation = goal.relation
            if relation is not None and relation.reference is not None:
                relation = relation.model_copy(update={"reference": ids[relation.reference]})
            objects = tuple(ids[number] for number in goal.objects)
            placed = goal.model_copy(update={"objects": objects, "relation": relation})
            placed.check_relation()
            self.goals.append(placed)
        self.lang_goals = [goal.language for goal in self.goals]

    def oracle(self, env: TabletopSim) -> Oracle:
        """An agent that solves the task with the instance's hand."""
        return make_oracle(self, env, self.end_effector)


def make_oracle(task: GoalTask, sim: TabletopSim, end_effector: EndEffector) -> Oracle:
    """The oracle that acts with a hand."""
    return PushOracle(task, sim) if end_effector.tool == "spatula" else Oracle(task, sim)


TaskT = TypeVar("TaskT", bound=GoalTask)


class TabletopEpisode(Generic[TaskT]):
    """Episodes of a task on a simulated table; each ``reset`` begins a new episode.

    Args:
        sim: the table.
        task: sets its scene up and states the goals.
        end_effector: hand that carries out the actions.

    Example::

        episode = open_instance_episode(instance, library)
        episode.reset()
        _, reward, done, _ = episode.step({"pose0": pick, "pose1": place})
    """

    def __init__(self, sim: TabletopSim, task: TaskT, end_effector: EndEffector) -> None:
        self.sim, self.task, self.end_effector = sim, task, end_effector

    @property
    def recorder(self) -> Recorder:
        """Recorder of the present episode."""
        return self.sim.recorder

    def reset(self) -> None:
        """Set the scene up and let it come to rest; errors as ``set_up_scene``."""
        self.set_up_scene()
        self.settle_scene()

    def set_up_scene(self) -> None:
        """Clear the table and let the task set its scene up; nothing has settled yet.

        Raises:
            SimulationError: the scene cannot be set up.
        """
        sim, task = self.sim, self.task
        sim.recorder.freeze()
        sim.places = {}
        sim.remove_all_objects()
        sim.recorder = Recorder(parse_max_steps(task.max_steps))
        set_last_recorder(sim.recorder)
        try:
            sim.end_effector = self.end_effector
            unfinished = cast(object, task.reset(sim))  # of an async reset or a generator: its body has not run
            if isinstance(unfinished, Coroutine | Generator | AsyncGenerator):
                if not isinstance(unfinished, AsyncGenerator):
                    unfinished.close()  # else Python warns that nobody awaited it
                is_generator = isinstance(unfinished, Generator)
                kind = "a generator (it has a yield)" if is_generator else "asynchronous (async def)"
                raise SimulationError(
                    f"reset is {kind}, so that nothing in it ran when it was called",
                    "write `def reset(self, env):` without async or yield",
                )
            task.finish_goals(sim)
        except GrsError as error:
            sim.recorder.stop = make_stop_from_error(error)
            raise
        task.grs.finish_reset(sim)
        sim.restore_bystanders()

    def settle_scene(self) -> None:
        """Let the scene come to rest; scores are measured against it from now on."""
        self.sim.settle_scene()
        self.sim.recorder.measure = StrictScorer(self.task, self.sim).measure_scene

    def step(self, action: Action | None = None) -> tuple[VisibleScene, float, bool, dict[str, Any]]:
        """Carry out an action and score.

        Args:
            action: ``{'pose0': start, 'pose1': end}`` of the tip; None to wait.

        Returns:
            (visible scene, reward added by this step, done, {}). ``done``: all goals met, or ``max_steps`` used.
        """
        sim, task = self.sim, self.task
        if action is None:
            sim.physics.step(WAIT_STEPS)
            reward = task.reward()[0]
        else:
            missing = {"pose0", "pose1"} - set(action)
            if missing:
                raise SimulationError(
                    f"env.step: the action has no {min(missing)}", "give {'pose0': (xyz, quaternion), 'pose1': ...}"
                )
            start, end = parse_pose(action["pose0"], "pose0"), parse_pose(action["pose1"], "pose1")
            effect = sim.end_effector.act(sim, start, end)
            sim.physics.raise_if_diverged()
            reward = task.reward()[0]
            sim.recorder.actions.append(
                ActionRecord(
                    object=effect.object,
                    asset="" if effect.object is None else sim.object_by_id(effect.object).asset,
                    pick=start[0],
                    place=end[0],
                    reward=reward,
                    note=effect.note,
                    trouble=effect.trouble,
                    pushed=effect.pushed,
                )
            )
            set_last_recorder(sim.recorder)
        done = task.done() or len(sim.recorder.actions) >= task.max_steps
        return sim.visible_scene, reward, done, {}


InstanceEpisode = TabletopEpisode[InstanceTask]


def open_instance_episode(instance: TaskInstance, library: Library, budget: int = DEFAULT_BUDGET) -> InstanceEpisode:
    """Episodes of a task instance on a table of its own, with its robot and time step; call ``reset`` to begin."""
    sim = TabletopSim(library, seed=instance.seed, budget=budget, robot=instance.robot, hand=instance.hand)
    return change_instance(sim, instance)


def change_instance(sim: TabletopSim, instance: TaskInstance) -> InstanceEpisode:
    """Episodes of another instance for the same robot on a table: instances that differ in poses share its world."""
    sim.timestep = instance.timestep
    task = InstanceTask(instance)
    return TabletopEpisode(sim, task, task.end_effector)


class SteppedEpisode(Protocol):
    """Episode that an oracle acts in: a ``TabletopEpisode``, or an ``Environment``."""

    @property
    def recorder(self) -> Recorder:
        """Recorder of the present episode."""
        ...

    def step(self, action: dict[str, Pose]) -> tuple[Any, float, bool, Any]:
        """Carry out an action and score; returns (observation, reward, done, info)."""
        ...


def follow_oracle(
    oracle: Oracle, episode: SteppedEpisode, noise: float = 0.0, rng: np.random.Generator | None = None
) -> None:
    """Let an oracle act in an episode that was just reset, until it is done or stops.

    An oracle that has solved the task before remembers its plans. With ``rng`` the hand misses each pose of an action
    by up to ``noise`` metres, in any direction; it tries an object again that it did not get hold of, as a robot does
    that feels no vacuum.
    """
    done = False
    while not done:
        action = oracle.act()
        if action is None:
            return
        for _ in range(1 if rng is None else PICKS):
            missed = dict(action)
            if rng is not None:
                for key, ((x, y, z), rotation) in action.items():
                    angle, away = rng.uniform(0, 2 * np.pi), noise * float(np.sqrt(rng.uniform()))
                    missed[key] = (x + away * float(np.cos(angle)), y + away * float(np.sin(angle)), z), rotation
            _, _, done, _ = episode.step(missed)
            if done or episode.recorder.actions[-1].object is not None:
                break


def parse_max_steps(value: Any) -> int:
    """The actions that a task allows; raises ``SimulationError`` for anything but a number."""
    try:
        return int(value)
    except (TypeError, ValueError, OverflowError) as error:
        raise SimulationError(f"max_steps is {value!r}"[:150], f"give a whole number of 1 to {MOST_STEPS}") from error
