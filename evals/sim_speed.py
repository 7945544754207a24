"""What the simulation costs, in CPU seconds and MiB, and how well the oracle does on the example programs."""

import json
import random
import statistics
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from types import ModuleType

import numpy as np
from rich.console import Console

from grs_agents.content import content_root
from grs_agents.library import Library
from grs_agents.metrics import Figure, metrics_table, metrics_to_dicts
from grs_agents.sim import Environment, Task, find_task_class, instantiate, rollout
from grs_agents.terminal import EscapingParser

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
    """Put groceries that stand in rows into one wide box."""

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


def pick_and_place(library: Library, repeats: int) -> float:
    """The median CPU time of the oracle's decision and the action together, 10 mesh objects, s."""
    taken: list[float] = []
    for seed in range(repeats):
        task = Packing(10)
        env = Environment(task=task, library=library, seed=seed)
        env.reset()
        oracle = task.oracle(env)
        for _ in range(task.max_steps):
            start = time.process_time()
            action = oracle.act()
            if action is None:
                break
            done = env.step(action)[2]
            taken.append(time.process_time() - start)
            if done:
                break
    return statistics.median(taken)


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


def scores(library: Library, seeds: int) -> list[tuple[str, float, float]]:
    """For each example program its mean published and strict score over seeds."""
    found: list[tuple[str, float, float]] = []
    for path in sorted((content_root() / "prompts" / "examples").glob("*.py")):
        rewards: list[float] = []
        strict: list[float] = []
        for seed in range(seeds):
            random.seed(seed)
            np.random.seed(seed)
            done = rollout(instantiate(load(path)(), seed, library), library)
            rewards.append(done.reward)
            strict.append(done.strict_score)
        found.append((path.stem, statistics.mean(rewards), statistics.mean(strict)))
        print(f"{path.stem}: {rewards[-1]:.2f}", file=sys.stderr)
    return found


def peak_memory() -> float:
    """Peak memory of a fresh process that runs the packing task, MiB; 0 where there is no /proc.

    Not ``ru_maxrss``: a process inherits that of the one it was forked from.
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


def measure(repeats: int, seeds: int) -> tuple[list[Figure], list[tuple[str, float, float]]]:
    """Every figure, and the score of each example program."""
    library = Library()
    packing(library)  # assets are read and code is warm before anything is timed
    fresh, moved, again = resets(library, repeats)
    whole = statistics.median(cpu_seconds(lambda: packing(library)) for _ in range(repeats))
    figures = [
        Figure(name="pick-and-place, 10 objects", value=pick_and_place(library, repeats), target=0.04, unit="s"),
        Figure(name="reset with compile, 10 mesh objects", value=fresh, target=0.04, unit="s"),
        Figure(name="reset, same model, other places", value=1000 * moved, target=2, unit="ms"),
        Figure(name="reset, same scene", value=1000 * again, target=2, unit="ms"),
        Figure(name="packing, 6 objects, 3 seeds", value=whole, target=1, unit="s"),
        Figure(name="peak memory of packing", value=peak_memory(), target=200, unit="MiB"),
    ]
    programs = scores(library, seeds) if seeds else []
    for index, name, target in ((1, "published", 0.98), (2, "strict", 0.95)) if programs else ():
        value = statistics.mean(float(program[index]) for program in programs)
        figures.append(
            Figure(name=f"oracle, mean {name} score", value=value, target=target, unit="", smaller_is_better=False)
        )
    return figures, programs


def main(arguments: Sequence[str]) -> int:
    """Measure and print.

    Returns:
        0 if every target is kept, 1 if not.
    """
    from grs_agents.runs import positive_int

    parser = EscapingParser(prog="grs eval sim_speed", description=__doc__)
    parser.add_argument("--repeats", type=positive_int, default=5, help="how often each timing is repeated")
    parser.add_argument("--seeds", type=int, default=10, help="seeds of each example program; 0 leaves them out")
    parser.add_argument("--json", action="store_true", help="print the figures as JSON")
    options = parser.parse_args(arguments)
    figures, programs = measure(options.repeats, options.seeds)
    if options.json:
        scored = [{"program": name, "published": reward, "strict": strict} for name, reward, strict in programs]
        print(json.dumps({"figures": metrics_to_dicts(figures), "programs": scored}, indent=2))
    else:
        Console().print(metrics_table("simulation", figures))
    return 0 if all(figure.is_target_met for figure in figures) else 1
