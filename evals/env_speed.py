"""Cost of the gymnasium environments: steps, resets and pictures, in CPU seconds."""

import tempfile
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from grs_agents.envs import GrsEnv
from grs_agents.library.library import Library
from grs_agents.runs.metrics import Figure
from grs_agents.sim import Environment, Task, inside, instantiate

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
    """Calls per CPU second, the best of three rounds: other load on the machine only slows them."""
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


def figure(name: str, value: float, target: float | None) -> Figure:
    """A rate."""
    return Figure(name=name, value=value, target=target, unit="per CPU s", smaller_is_better=False)


def measure_states(run: Path, count: int) -> list[Figure]:
    """Steps with each control, and resets."""
    environments = {control: GrsEnv(run, control=control) for control in ("ee_delta", "joint_position")}
    rates = [
        figure(f"state steps, {control}", rate(stepping(env), count), 2000) for control, env in environments.items()
    ]
    env = environments["joint_position"]
    return [*rates, figure("resets", rate(lambda: env.reset(seed=0), 10 + count // 20), None)]


def measure_pictures(run: Path, count: int, renderer: str, target: float) -> list[Figure]:
    """Pictures by a renderer, and steps with a picture each; none if ``auto`` finds ray casting only."""
    arguments: dict[str, Any] = {"cameras": ("front",), "renderer": renderer}
    env = GrsEnv(run, **arguments)
    env.reset(seed=0)
    used = env.renderer
    if renderer == "auto" and used == "rays":
        return []
    pictures = figure(f"pictures of 96x128, {used}", rate(env.take_pictures, 20 + count // 10), target)
    steps = figure(f"steps with a picture, {used}", rate(stepping(env), 20 + count // 10), None)
    env.close()
    return [pictures, steps]


def write_instance(folder: Path, **robot: str) -> Path:
    """A folder with a single instance: eight cans and a box; ``robot`` and ``hand`` replace the shipped UR5e's."""
    (folder / "instances").mkdir()
    instance = instantiate(CansIntoBox(), 0, Library()).model_copy(update=robot)
    (folder / "instances" / "seed_0.json").write_text(instance.model_dump_json(), encoding="utf-8")
    return folder


def main(arguments: Sequence[str]) -> int:
    """Measure and print.

    Returns:
        0 if every target is kept, 1 if not.
    """
    from grs_agents.runs.experiment_run import ExperimentParser
    from grs_agents.runs.experiments import positive_int

    parser = ExperimentParser("env_speed", __doc__)
    parser.add_argument("run", nargs="?", type=Path, help="an accepted run; eight cans and a box if left out")
    parser.add_argument("--steps", type=positive_int, default=1000, help="steps of each timing")
    experiment = parser.start(arguments)
    steps = experiment.options.steps
    with tempfile.TemporaryDirectory() as folder:
        run = experiment.options.run or write_instance(Path(folder))
        figures = experiment.measure(
            {
                "states": lambda: measure_states(run, steps),
                "rays": lambda: measure_pictures(run, steps, "rays", 200),
                "OpenGL": lambda: measure_pictures(run, steps, "auto", 500),
            }
        )
    return experiment.tell_figures("environments", figures)
