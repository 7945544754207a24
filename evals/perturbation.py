"""Success rate of the expert under unexpected friction, masses and hand noise."""

import hashlib
import random
from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from types import ModuleType
from typing import Any, Final

import numpy as np

from grs_agents.base import Frozen
from grs_agents.base.content import content_root
from grs_agents.base.errors import GrsError
from grs_agents.library.library import Library
from grs_agents.sim import Environment, InstanceObject, InstanceTask, TaskInstance, find_task_class, run_oracle
from grs_agents.sim import instantiate as instantiate_task
from grs_agents.sim.world.spec import fill_in_masses_and_frictions

_SOLVED: Final = 0.9
"""Least reward and strict score of a solved episode, as in `audit.reward`."""
_TRIES: Final = 5
"""Actions for each action of a task: a noisy hand repeats failed grasps."""
_SHARE: Final = 0.3
"""Relative change of friction and mass."""


class _Condition(Frozen):
    """A perturbation."""

    friction: float = 1.0  # factor
    mass: float = 1.0  # factor
    noise: float = 0.0  # metres that the hand may miss each pose by


CONDITIONS: Final[Mapping[str, _Condition]] = {
    "as it is": _Condition(),
    "friction -30 %": _Condition(friction=1 - _SHARE),
    "friction +30 %": _Condition(friction=1 + _SHARE),
    "mass -30 %": _Condition(mass=1 - _SHARE),
    "mass +30 %": _Condition(mass=1 + _SHARE),
    "hand 5 mm": _Condition(noise=0.005),
    "hand 10 mm": _Condition(noise=0.01),
}


class _Program(Frozen):
    """The seeds of a program that were solved, by condition."""

    program: str
    solved: dict[str, tuple[int, ...]]


def main(arguments: Sequence[str]) -> int:
    """Measure and print.

    Returns:
        0 if friction and mass change nothing, and 97 % are solved with 5 mm and 75 % with 10 mm; else 1.
    """
    from grs_agents.runs.experiment_run import ExperimentParser
    from grs_agents.runs.experiments import positive_int

    parser = ExperimentParser("perturbation", __doc__)
    parser.add_argument("--tasks", type=positive_int, default=10, help="how many example programs, drawn at random")
    parser.add_argument("--seeds", type=positive_int, default=20, help="seeds of each program")
    experiment = parser.start(arguments)
    count = experiment.options.seeds
    programs = sorted((content_root() / "prompts" / "examples").glob("*.py"))
    random.Random(experiment.config.seed).shuffle(programs)
    work = {path.stem: partial(measure_program, path, count) for path in sorted(programs[: experiment.options.tasks])}
    rows = experiment.make_or_reuse_rows(_Program, work)
    episodes = len(rows) * count
    solved = {name: sum(len(row.solved[name]) for row in rows) for name in CONDITIONS}
    table: list[dict[str, Any]] = []
    for name, number in solved.items():
        worst = min(rows, key=lambda row: len(row.solved[name]))
        text = f"{worst.program}, {len(worst.solved[name])} of {count}"
        table.append({"condition": name, "solved": f"{number} of {episodes}", "worst program": text})
    experiment.tell(table, programs={row.program: row.solved for row in rows})
    least = solved["as it is"] - 0.01 * episodes
    same = all(solved[name] >= least for name, condition in CONDITIONS.items() if not condition.noise)
    return 0 if same and solved["hand 5 mm"] >= 0.97 * episodes and solved["hand 10 mm"] >= 0.75 * episodes else 1


def measure_program(path: Path, seeds: int) -> _Program:
    """The seeds below ``seeds`` whose task the expert solves, for each condition."""
    module = ModuleType(path.stem)
    exec(compile(path.read_text("utf-8"), str(path), "exec"), module.__dict__)
    task, library = find_task_class(module), Library()
    instances: list[TaskInstance] = []
    for seed in range(seeds):
        random.seed(seed)
        np.random.seed(seed)
        instances.append(fill_in_masses_and_frictions(instantiate_task(task(), seed, library), library))
    solved = {
        name: tuple(instance.seed for instance in instances if _is_solved(instance, condition, library))
        for name, condition in CONDITIONS.items()
    }
    return _Program(program=path.stem, solved=solved)


def _is_solved(instance: TaskInstance, condition: _Condition, library: Library) -> bool:
    changed = instance.model_copy(
        update={"objects": tuple(_perturb_object(item, condition) for item in instance.objects)}
    )
    task = InstanceTask(changed)
    env = Environment(task=task, library=library, seed=changed.seed, robot=changed.robot, hand=changed.hand)
    env.timestep = changed.timestep
    rng = None
    if condition.noise:
        task.max_steps *= _TRIES
        digest = hashlib.sha256(f"{changed.task} {changed.seed} {condition.noise}".encode()).digest()
        rng = np.random.default_rng(int.from_bytes(digest[:8]))
    try:
        env.reset()
        run_oracle(env, task, condition.noise, rng)
    except GrsError:
        return False
    episode = env.current_episode
    return episode.outcome == "success" and min(episode.reward, episode.strict) >= _SOLVED


def _perturb_object(item: InstanceObject, condition: _Condition) -> InstanceObject:
    if item.mass is None or item.friction is None:
        return item
    return item.model_copy(update={"mass": item.mass * condition.mass, "friction": item.friction * condition.friction})
