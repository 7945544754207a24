"""Making demonstrations: an instance, the expert on it, and what it did replayed through the environment."""

from collections.abc import Callable
from contextlib import closing
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any, Final

import numpy as np
from pydantic import Field

from grs_agents.base import Frozen
from grs_agents.base.errors import GrsError, InputError
from grs_agents.base.geometry.transforms import FloatArray
from grs_agents.sim.instance.episode import SimulationError
from grs_agents.sim.instance.task_instance import TaskInstance, hash_instance
from grs_agents.sim.motion.joint_controller import CONTROL_RATE
from grs_agents.sim.rendering.scene_cameras import Backend
from grs_agents.sim.variation.types import Variation
from grs_agents.sim.variation.vary import vary_instance
from grs_agents.tasks.demos.attempt_store import AttemptStore
from grs_agents.tasks.demos.expert_path import Flags, path_to_actions, record_expert
from grs_agents.tasks.demos.replay import Replayer
from grs_agents.tasks.demos.types import Demonstration, Dropped, installed_versions
from grs_agents.tasks.task_folder import TaskFolder

_PACES: Final = (1.0, 0.7)
"""How fast a replay goes against the expert: slower where what is held slips off at the control rate."""
_SPARE: Final = 20
"""No more attempts are made than twice the episodes that are wanted, and these."""
_VARIED: Final = Variation(jitter=0.03, yaw=float(np.deg2rad(30)))
"""What is varied unless something else is asked for."""


class DemoOrder(Frozen):
    """What is wanted; the same order gives the same demonstrations."""

    episodes: Annotated[int, Field(ge=1, le=1_000_000)] = 200
    seed: Annotated[int, Field(ge=0, lt=2**32)] = 0  # of the variations
    variation: Variation = _VARIED
    cameras: tuple[str, ...] = ()
    size: tuple[int, int] = (96, 128)  # rows and columns of the pictures
    renderer: Backend = "auto"


def make_demonstrations(
    folder: TaskFolder, order: DemoOrder, work: Path, show: Callable[[AttemptStore], None]
) -> AttemptStore:
    """Add to a working folder what it lacks of ``order.episodes`` demonstrations.

    The first attempts take the folder's instances as they are, the others vary them in turn. ``show`` is called before
    each attempt.

    Raises:
        InputError: there are fewer instances than episodes, and nothing is varied; their objects differ in number; or
            the working folder was begun with another order.
    """
    attempts = _Attempts(folder, order)
    made = AttemptStore(work, attempts.attempt_settings)
    with closing(attempts):
        for attempt in range(attempts.max_attempt_count):
            show(made)
            if made.count >= order.episodes:
                break
            if attempt not in made.attempts:
                made.add(attempt, attempts.make(attempt))
    return made


class _Attempts:
    """The attempts of an order, each the same whenever it is made."""

    def __init__(self, folder: TaskFolder, order: DemoOrder) -> None:
        self._folder, self._order = folder, order
        self._instances = {seed: folder.read_instance(seed) for seed in folder.seeds}
        counts = {(len(one.task_objects), one.robot): seed for seed, one in self._instances.items()}
        if len(counts) > 1:
            found = ", ".join(f"seed {seed} has {count} and {robot}" for (count, robot), seed in counts.items())
            raise InputError(
                f"the instances of {folder.path} differ in how many objects they have, or in the robot: {found}",
                "keep instances of one kind in one folder: a data set has one column for each joint and object",
            )
        if order.variation == Variation() and order.episodes > len(self._instances):
            found = f"{folder.path} has {len(self._instances)} instances as they are, {order.episodes} are wanted"
            raise InputError(found, "ask for fewer with --episodes, or vary them, e.g. with --jitter 0.03")
        if "photo" in order.cameras and any(one.camera is None for one in self._instances.values()):
            found = f"{folder.path} does not say where its photo was taken from"
            raise InputError(found, "leave the camera photo out")
        ((rows, robot),) = counts
        self._replayer = Replayer(folder.library, robot, rows, order.cameras, order.size, order.renderer)

    @property
    def max_attempt_count(self) -> int:
        """How many attempts may be made."""
        return len(self._instances) if self._order.variation == Variation() else 2 * self._order.episodes + _SPARE

    @property
    def attempt_settings(self) -> dict[str, Any]:
        """What the attempts depend on; more episodes may be wanted of the same ones."""
        return {
            "instances": {str(seed): hash_instance(instance) for seed, instance in self._instances.items()},
            **self._order.model_dump(exclude={"episodes"}),
            "versions": installed_versions(),
        }

    def make(self, attempt: int) -> Demonstration | Dropped:
        """One attempt."""
        seeds = tuple(self._instances)
        base = seeds[attempt % len(seeds)]
        instance, stage = self._instances[base], "variation"
        try:
            if attempt >= len(seeds):
                rng = np.random.default_rng((self._order.seed, attempt))
                instance = vary_instance(instance, self._order.variation, rng, self._folder.library)
            stage = "expert"
            path = self._record_expert_path(instance)
            stage = "replay"
            demonstration = self._replay_expert_path(instance, *path)
        except GrsError as error:
            return Dropped(stage=stage, why=error.message)
        return replace(demonstration, attempt=attempt, base_seed=base)

    def _record_expert_path(self, instance: TaskInstance) -> tuple[FloatArray, Flags]:
        """What the expert does; raises ``SimulationError`` where it does not solve the task."""
        episode = self._replayer.episode
        episode.begin(instance)
        path = record_expert(episode.env, episode.task)
        if not episode.is_solved():
            raise SimulationError(episode.env.current_episode.detail)
        return path

    def _replay_expert_path(self, instance: TaskInstance, positions: FloatArray, held: Flags) -> Demonstration:
        """The same again through the environment; raises ``SimulationError`` where that does not solve the task."""
        episode = self._replayer.episode
        period = round(1 / (CONTROL_RATE * instance.timestep))
        for pace in _PACES:
            episode.begin(instance)
            if demonstration := self._replayer.run(path_to_actions(positions, held, period, pace)):
                return demonstration
        raise SimulationError(episode.env.current_episode.detail)

    def close(self) -> None:
        """Give back what drawing holds."""
        self._replayer.close()
