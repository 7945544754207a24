"""What the gymnasium environments cost: steps, resets and pictures, in CPU seconds."""

import json
import tempfile
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console

from grs_agents.envs import GrsEnv
from grs_agents.library import Library
from grs_agents.metrics import Figure, metrics_table, metrics_to_dicts
from grs_agents.sim import Environment, Task, inside, instantiate
from grs_agents.terminal import EscapingParser

CANS = ("AlphabetSoup", "Corn", "GreenBeans", "Mushrooms", "Peaches", "Pineapple", "TomatoSauce", "Tuna")


class CansIntoBox(Task):
    """Put eight cans that stand in rows into a box."""

    def reset(self, env: Environment) -> None:
        """Cans at the right, the box at the left."""
        super().reset(env)
        size = (0.30, 0.40, 0.08)
        box = self.fill_template("container/container-template.urdf", {"DIM": size, "COLOR": "brown"})
        container = env.add_object(box, ((0.5, 0.25, 0.04), (0.0, 0.0, 0.0, 1.0)), "fixed")
        cans: list[int] = []
        for index, name in enumerate(CANS):
            urdf = f"HOPE/{name}.urdf"
            position = (0.36 + 0.1 * (index % 4), -0.1 - 0.14 * (index // 4), env.library.asset(urdf).size[2] / 2)
            cans.append(env.add_object(urdf, (position, (0.0, 0.0, 0.0, 1.0))))
        self.add_goal(inside(cans, container), language_goal="put the cans into the box")


def rate(work: Callable[[], object], count: int) -> float:
    """Calls per CPU second, the best of three rounds: what else runs on the machine only ever slows."""
    work()
    taken: list[float] = []
    for _ in range(3):
        start = time.process_time()
        for _ in range(count):
            work()
        taken.append(time.process_time() - start)
    return count / min(taken)


def stepping(env: GrsEnv) -> Callable[[], object]:
    """A random step; an episode that ended begins anew."""
    rng = np.random.default_rng(0)
    size = env.action_space.shape or (0,)
    env.reset(seed=0)

    def step() -> None:
        if any(env.step(rng.uniform(-1.0, 1.0, size).astype(np.float32))[2:4]):
            env.reset()

    return step


def measure(run: Path, count: int) -> list[Figure]:
    """Every figure of a task folder."""
    figures: list[Figure] = []

    def add(name: str, value: float, target: float | None) -> None:
        figures.append(Figure(name=name, value=value, target=target, unit="per CPU s", smaller_is_better=False))

    for control in ("ee_delta", "joint_position"):
        env = GrsEnv(run, control=control)
        add(f"state steps, {control}", rate(stepping(env), count), 2000)
    add("resets", rate(lambda: env.reset(seed=0), 10 + count // 20), None)
    for renderer, target in (("rays", 200), ("auto", 500)):
        arguments: dict[str, Any] = {"cameras": ("front",), "renderer": renderer}
        env = GrsEnv(run, **arguments)
        env.reset(seed=0)
        used = env.renderer
        if renderer == "auto" and used == "rays":
            continue
        add(f"pictures of 96x128, {used}", rate(env.take_pictures, 20 + count // 10), target)
        add(f"steps with a picture, {used}", rate(stepping(env), 20 + count // 10), None)
        env.close()
    return figures


def write_instance(folder: Path) -> Path:
    """A folder of one instance: eight cans and a box."""
    (folder / "instances").mkdir()
    text = instantiate(CansIntoBox(), 0, Library()).model_dump_json()
    (folder / "instances" / "seed_0.json").write_text(text, encoding="utf-8")
    return folder


def main(arguments: Sequence[str]) -> int:
    """Measure and print.

    Returns:
        0 if every target is kept, 1 if not.
    """
    from grs_agents.runs import positive_int

    parser = EscapingParser(prog="grs eval env_speed", description=__doc__)
    parser.add_argument("run", nargs="?", type=Path, help="an accepted run; eight cans and a box if left out")
    parser.add_argument("--steps", type=positive_int, default=1000, help="steps of each timing")
    parser.add_argument("--json", action="store_true", help="print the figures as JSON")
    options = parser.parse_args(arguments)
    with tempfile.TemporaryDirectory() as folder:
        figures = measure(options.run or write_instance(Path(folder)), options.steps)
    if options.json:
        print(json.dumps({"figures": metrics_to_dicts(figures)}, indent=2))
    else:
        Console().print(metrics_table("environments", figures))
    return 0 if all(figure.is_target_met is not False for figure in figures) else 1
