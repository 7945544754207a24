"""An episode of an instance's task: the simulation that trusted rollouts run, begun again and again."""

from typing import Final

import numpy as np

from grs_agents.base.geometry.transforms import FloatArray
from grs_agents.library.library import Library
from grs_agents.sim.cliport.environment import Environment
from grs_agents.sim.goals.strict_score import StrictScorer
from grs_agents.sim.instance.task_instance import TaskInstance
from grs_agents.sim.rollouts import InstanceTask
from grs_agents.sim.world.physics import Physics

SOLVED: Final = 0.985
"""Strict score from which on a task is solved."""
_BUDGET: Final = 10**15
"""Simulated steps: none of it runs code that could ask for too many."""


class TaskEpisode:
    """The present episode. What was compiled for one instance serves others that differ in their objects' places."""

    env: Environment
    task: InstanceTask
    instance: TaskInstance
    object_ids: tuple[int, ...]  # of the task's objects in ``env``, in the instance's order

    def __init__(self, library: Library) -> None:
        self.library = library
        self._robot: str | None = None

    def begin(self, instance: TaskInstance) -> None:
        """Set the scene of an instance up and let it settle; raises ``SimulationError`` where that cannot be."""
        if self._robot != instance.robot:
            self.env = Environment(library=self.library, seed=instance.seed, budget=_BUDGET, robot=instance.robot)
            self._robot = instance.robot
        self.instance, self.task = instance, InstanceTask(instance)
        self.env.set_task(self.task)
        self.env.timestep = instance.timestep
        self.env.reset()
        self.object_ids = tuple(self.task.ids[item.id] for item in instance.task_objects)
        self._scorer = StrictScorer(self.task, self.env)
        self._judged, self._solved = self._object_state(), False

    @property
    def physics(self) -> Physics:
        """The running world."""
        return self.env.physics

    @property
    def strict_score(self) -> float:
        """How far every goal holds now, judged strictly, 0..1."""
        return self._scorer.measure_scene().strict

    def is_solved(self) -> bool:
        """Whether nothing is held, every goal was met, and all hold strictly now."""
        if self.physics.held_object_id is not None:
            return False
        now = self._object_state()
        if not np.array_equal(now, self._judged):  # resting bodies sleep, and stay where they are to the bit
            self._judged = now
            self.task.reward()
            self._solved = self.task.done() and self.strict_score >= SOLVED
        return self._solved

    def _object_state(self) -> FloatArray:
        return np.array(self.physics.data.qpos[self.physics.dof :])
