"""Episodes of task instances on a simulated table, for environments and demonstrations."""

from typing import Final

from grs_agents.base.geometry.transforms import FloatArray
from grs_agents.library.library import Library
from grs_agents.sim.goals.scores import SOLVED
from grs_agents.sim.goals.strict_score import StrictScorer
from grs_agents.sim.instance.episode import GoalOutcome
from grs_agents.sim.instance.task_instance import TaskInstance
from grs_agents.sim.tabletop import TabletopSim
from grs_agents.sim.tabletop_episode import InstanceEpisode, InstanceTask, change_instance
from grs_agents.sim.world.physics import Physics

_BUDGET: Final = 10**15
"""Simulated steps: no limit, since no generated code runs here."""


class TaskEpisode:
    """The present episode; instances that differ in their objects' poses alone share a compiled world.

    Attributes:
        sim: the table.
        current: the episode of the present instance.
        instance: the present instance.
        object_ids: ids of the task's objects on the table, in the instance's order.
    """

    sim: TabletopSim
    current: InstanceEpisode
    instance: TaskInstance
    object_ids: tuple[int, ...]

    def __init__(self, library: Library) -> None:
        self.library = library
        self._robot: tuple[str, str] | None = None

    def begin(self, instance: TaskInstance) -> None:
        """Set the scene of an instance up and let it settle; raises ``SimulationError`` if that fails."""
        if self._robot != (robot := (instance.robot, instance.hand)):
            self.sim = TabletopSim(
                self.library, seed=instance.seed, budget=_BUDGET, robot=instance.robot, hand=instance.hand
            )
            self._robot = robot
        self.instance, self.current = instance, change_instance(self.sim, instance)
        self.current.reset()
        self.object_ids = tuple(self.task.ids[item.id] for item in instance.task_objects)
        self._scorer = StrictScorer(self.task, self.sim)
        self._judged, self._solved = self._object_state(), False

    @property
    def task(self) -> InstanceTask:
        """The task of the present instance."""
        return self.current.task

    @property
    def physics(self) -> Physics:
        """The running world."""
        return self.sim.physics

    @property
    def strict_score(self) -> float:
        """Strict score of all goals now, 0..1."""
        return self._scorer.measure_scene().strict

    def measure_goals(self) -> tuple[GoalOutcome, ...]:
        """State of each goal now."""
        return self._scorer.measure_scene().goals

    def is_solved(self) -> bool:
        """Whether nothing is held, every goal was met, and both scores reach ``SOLVED``, as in the audit's rollouts."""
        if self.physics.held_object_id is not None:
            return False
        now = self._object_state()
        if now != self._judged:  # resting bodies sleep, and stay where they are to the bit
            self._judged = now
            self.task.reward()
            self._solved = self.task.done() and min(self.task.get_reward(), self.strict_score) >= SOLVED
        return self._solved

    def _object_state(self) -> bytes:
        positions: FloatArray = self.physics.data.qpos[self.physics.world.first_free :]
        return positions.tobytes()
