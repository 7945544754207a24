"""Cost of the simulation, in CPU seconds and MiB, and success of the oracle on the example programs."""

import random
import statistics
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from types import ModuleType

import numpy as np

from grs_agents.base.content import content_root
from grs_agents.base.mujoco_import import mujoco
from grs_agents.library.library import Library
from grs_agents.runs.metrics import Figure
from grs_agents.sim import Environment, Rollout, Task, find_task_class, instantiate, rollout
from grs_agents.sim.world.physics import Physics

BOX_SIZE = (0.34, 0.40, 0.10)
BOX_POSE = ((0.50, 0.25, 0.05), (0.0, 0.0, 0.0, 1.0))
GROCERIES = (
    "AlphabetSoup",
    "Butter",
    "Corn",
    "GreenBeans",
    "Mushrooms",
    "Peaches",
    "Pineapple",
    "TomatoSauce",
    "Tuna",
    "Yogurt",
)


class Packing(Task):
    """Put groceries that stand in rows into a wide box."""

    def __init__(self, count: int) -> None:
        super().__init__()
        self.items, self.max_steps = count, 2 * count

    def reset(self, env: Environment) -> None:
        """Rows of mesh objects at the right, the box at the left; the seed turns each object."""
        super().reset(env)
        box = self.fill_template("container/container-template.urdf", {"DIM": BOX_SIZE, "COLOR": "brown"})
        env.add_object(box, BOX_POSE, "fixed")
        objects: list[int] = []
        for index, name in enumerate(GROCERIES[: self.items]):
            urdf = f"HOPE/{name}.urdf"
            yaw = float(env.rng.uniform(-np.pi, np.pi))
            position = (0.34 + 0.10 * (index % 4), -0.08 - 0.12 * (index // 4), env.library.asset(urdf).size[2] / 2)
            objects.append(env.add_object(urdf, (position, (0.0, 0.0, np.sin(yaw / 2), np.cos(yaw / 2)))))
        matches, zone = np.ones((self.items, 1)), [(BOX_POSE, BOX_SIZE)]
        self.add_goal(objects, matches, [BOX_POSE], True, False, "zone", zone, 1.0, language_goal="pack the box")


def cpu_seconds(work: Callable[[], object]) -> float:
    """CPU time that a call takes in this process."""
    start = time.process_time()
    work()
    return time.process_time() - start


def pick_and_place(library: Library, repeats: int) -> tuple[float, float]:
    """Median CPU time of the oracle's decision and the action together, 10 mesh objects, s; and that of ``mj_step``
    alone for as many time steps as pass in it, from where it ended."""
    taken: list[float] = []
    alone: list[float] = []
    for seed in range(repeats):
        task = Packing(10)
        env = Environment(task=task, library=library, seed=seed)
        env.reset()
        oracle = task.oracle(env)
        for _ in range(task.max_steps):
            left, start = env.budget.left, time.process_time()
            action = oracle.act()
            if action is None:
                break
            done = env.step(action)[2]
            taken.append(time.process_time() - start)
            alone.append(_time_dynamics(env.physics, left - env.budget.left))
            if done:
                break
    return statistics.median(taken), statistics.median(alone)


def _time_dynamics(physics: Physics, steps: int) -> float:
    data = mujoco.MjData(physics.model)
    mujoco.mj_copyData(data, physics.model, physics.data)
    return cpu_seconds(lambda: mujoco.mj_step(physics.model, data, steps))


def resets(library: Library, repeats: int) -> tuple[float, float, float]:
    """Median CPU time of a reset of 10 mesh objects: compiled anew, same model in other places, same scene, s."""
    fresh = [
        cpu_seconds(Environment(task=Packing(10), library=library, seed=seed).reset) for seed in range(2 * repeats)
    ]
    env = Environment(task=Packing(10), library=library, seed=0)
    env.reset()
    moved = [cpu_seconds(env.reset) for _ in range(4 * repeats)]
    again: list[float] = []
    for _ in range(4 * repeats):
        env.seed(0)
        again.append(cpu_seconds(env.reset))
    return statistics.median(fresh), statistics.median(moved), statistics.median(again)


def packing(library: Library) -> None:
    """Three seeds of a packing task with 6 objects: task instance, idle check, oracle, score."""
    for seed in range(3):
        done = rollout(instantiate(Packing(6), seed, library), library)
        if done.episode.outcome != "success":
            raise RuntimeError(f"seed {seed}: {done.episode.detail}")


def load(path: Path) -> type[Task]:
    """The task of a program file."""
    module = ModuleType(path.stem)
    exec(compile(path.read_text("utf-8"), str(path), "exec"), module.__dict__)
    return find_task_class(module)


def measure_scores(path: Path, library: Library, seeds: int) -> list[Figure]:
    """The mean published and strict score of an example program over seeds."""
    done: list[Rollout] = []
    for seed in range(seeds):
        random.seed(seed)
        np.random.seed(seed)
        done.append(rollout(instantiate(load(path)(), seed, library), library))
    means = {
        "published": statistics.mean(result.reward for result in done),
        "strict": statistics.mean(result.strict_score for result in done),
    }
    return [Figure(name=f"{path.stem}, {kind}", value=mean, smaller_is_better=False) for kind, mean in means.items()]


def peak_memory() -> float:
    """Peak memory of a fresh process that runs the packing task, MiB; 0 without /proc.

    ``ru_maxrss`` would include that of the parent process at the fork.
    """
    code = (
        "from grs_agents import content; from grs_agents.library import Library;"
        "content.load_module('evals', 'sim_speed').packing(Library());"
        "print(next((line.split()[1] for line in open('/proc/self/status') if line.startswith('VmHWM')), 0))"
    )
    if not Path("/proc/self/status").exists():
        return 0.0
    printed = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout
    return int(printed) / 1024


def timings(library: Library, repeats: int) -> dict[str, Callable[[], Sequence[Figure]]]:
    """The timed functions."""

    def measure_resets() -> list[Figure]:
        fresh, moved, again = resets(library, repeats)
        return [
            Figure(name="reset with compile, 10 mesh objects", value=fresh, target=0.04, unit="s"),
            Figure(name="reset, same model, other places", value=1000 * moved, target=2, unit="ms"),
            Figure(name="reset, same scene", value=1000 * again, target=2, unit="ms"),
        ]

    def measure_packing() -> list[Figure]:
        whole = statistics.median(cpu_seconds(lambda: packing(library)) for _ in range(repeats))
        return [
            Figure(name="packing, 6 objects, 3 seeds", value=whole, target=1, unit="s"),
            Figure(name="peak memory of packing", value=peak_memory(), target=200, unit="MiB"),
        ]

    def measure_actions() -> list[Figure]:
        value, alone = pick_and_place(library, repeats)
        return [
            Figure(name="pick-and-place, 10 objects", value=value, target=0.04, unit="s"),
            Figure(name="pick-and-place, over mj_step alone", value=value / alone, target=1.5),
        ]

    return {"actions": measure_actions, "resets": measure_resets, "packing": measure_packing}


def main(arguments: Sequence[str]) -> int:
    """Measure and print.

    Returns:
        0 if every target is kept, 1 if not.
    """
    from grs_agents.runs.experiment_run import ExperimentParser
    from grs_agents.runs.experiments import positive_int

    parser = ExperimentParser("sim_speed", __doc__)
    parser.add_argument("--repeats", type=positive_int, default=5, help="how often each timing is repeated")
    parser.add_argument("--seeds", type=int, default=10, help="seeds of each example program; 0 leaves them out")
    experiment = parser.start(arguments)
    library, seeds = Library(), experiment.options.seeds
    packing(library)  # assets are read and code is warm before anything is timed
    programs = sorted((content_root() / "prompts" / "examples").glob("*.py")) if seeds else []
    measured = experiment.measure(
        {
            **timings(library, experiment.options.repeats),
            **{path.stem: lambda path=path: measure_scores(path, library, seeds) for path in programs},
        }
    )
    figures = measured[: len(measured) - 2 * len(programs)]
    scores = measured[len(figures) :]
    for kind, group, target in (("published", scores[::2], 0.98), ("strict", scores[1::2], 0.95)) if programs else ():
        value = statistics.mean(score.value or 0.0 for score in group)
        figures.append(Figure(name=f"oracle, mean {kind} score", value=value, target=target, smaller_is_better=False))
    return experiment.tell_figures("simulation", figures, programs={score.name: score.value for score in scores})
