"""Environment steps, pictures and resets beside other packages, each in a Python of its own, in CPU seconds."""

import json
import subprocess
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

from grs_agents.base import content
from grs_agents.base.errors import ConfigError
from grs_agents.envs import GrsEnv
from grs_agents.runs.metrics import Figure


class Peer(NamedTuple):
    """A task of another package.

    Attributes:
        venv: folder of the venv that has the package.
        package: its name in the index.
        task: its robot and task.
    """

    venv: str
    package: str
    task: str


GRS, FINGERS, LIFT = "GRS", "GRS with fingers", "robosuite_lift"
PEERS = {
    "fetch": Peer("fetch", "gymnasium-robotics", "FetchPickAndPlace-v4"),
    "panda_gym": Peer("panda_gym", "panda-gym", "PandaPickAndPlace-v3"),
    "dm_control": Peer("dm_control", "dm_control", "manipulation, stack_2_bricks_features"),
    "robosuite": Peer("robosuite", "robosuite", "PickPlace with a Panda and operational space control"),
    LIFT: Peer("robosuite", "robosuite", "Lift with a Panda and operational space control"),
}
BESIDE = {FINGERS: GRS, LIFT: FINGERS}
"""The rates that a row is divided into, of GRS with its suction cup by default."""
PROGRAM = """
import json, sys, time
import numpy as np
peer, steps, size = sys.argv[1], int(sys.argv[2]), int(sys.argv[3])

def rate(work, count):
    work()
    taken = []
    for _ in range(3):
        start = time.process_time()
        for _ in range(count):
            work()
        taken.append(time.process_time() - start)
    return count / min(taken)

def gymnasium_stepping(env):
    env.action_space.seed(0)
    env.reset(seed=0)
    def step():
        if any(env.step(env.action_space.sample())[2:4]):
            env.reset()
    return step

picture = None
if peer == "fetch":
    import gymnasium, gymnasium_robotics
    gymnasium.register_envs(gymnasium_robotics)
    env = gymnasium.make("FetchPickAndPlace-v4", render_mode="rgb_array", width=size, height=size)
    step, reset, hertz = gymnasium_stepping(env), env.reset, 25
    picture = env.render
elif peer == "panda_gym":
    import gymnasium, panda_gym
    drawn = dict(render_mode="rgb_array", renderer="Tiny", render_width=size, render_height=size)
    env = gymnasium.make("PandaPickAndPlace-v3", **drawn)
    step, reset, hertz = gymnasium_stepping(env), env.reset, 25
    picture = env.render
elif peer == "dm_control":
    from dm_control import manipulation
    env = manipulation.load("stack_2_bricks_features", seed=0)
    spec, rng = env.action_spec(), np.random.default_rng(0)
    env.reset()
    def step():
        if env.step(rng.uniform(spec.minimum, spec.maximum)).last():
            env.reset()
    reset, hertz = env.reset, 1 / env.control_timestep()
    picture = lambda: env.physics.render(size, size, camera_id=0)
elif peer.startswith("robosuite"):
    import robosuite
    task = {"robosuite": "PickPlace", "robosuite_lift": "Lift"}[peer]
    arguments = dict(robots="Panda", has_renderer=False, use_camera_obs=False, control_freq=20, ignore_done=True)
    env = robosuite.make(task, has_offscreen_renderer=True, **arguments)
    low, high = env.action_spec
    rng = np.random.default_rng(0)
    env.reset()
    step = lambda: env.step(rng.uniform(low, high))
    reset, hertz = env.reset, 20
    picture = lambda: env.sim.render(size, size, camera_name="frontview")
found = {"hertz": hertz, "steps": rate(step, steps), "resets": rate(reset, max(steps // 100, 3))}
try:
    picture()
    found["pictures"] = rate(lambda: (step(), picture()), steps // 5)
except Exception as error:
    found["error"] = f"{type(error).__name__}: {error}"
print(json.dumps(found))
"""
"""Measures a peer in its own Python: steps at a control rate, steps with a picture, resets."""


def measure_grs(steps: int, size: int, **robot: str) -> dict[str, float]:
    """Steps, steps with a picture, and resets of GRS per CPU second, at 25 Hz; ``robot`` and ``hand`` by name."""
    timing = content.load_module("evals", "env_speed")
    rate, stepping = timing.rate, timing.stepping
    with tempfile.TemporaryDirectory() as folder:
        run = timing.write_instance(Path(folder), **robot)
        env = GrsEnv(run, control="ee_delta")
        rates = {"hertz": 25.0, "steps": rate(stepping(env), steps)}
        rates["resets"] = rate(lambda: env.reset(seed=0), max(steps // 10, 3))
        env = GrsEnv(run, control="ee_delta", cameras=("front",), image_size=(size, size))
        rates["pictures"] = rate(stepping(env), steps // 5)
        env.close()
    return rates


def measure_peer(peer: str, python: str, steps: int, size: int) -> dict[str, float]:
    """The same of a peer, whose package is installed for ``python``.

    Raises:
        ConfigError: The peer does not run there.
    """
    command = [python, "-c", PROGRAM, peer, str(steps), str(size)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode:
        last = (done.stderr.strip().splitlines() or [f"exit status {done.returncode}"])[-1]
        raise ConfigError(f"{peer} does not run with {python}: {last}", f"pip install {PEERS[peer].package} there")
    rates: dict[str, float] = json.loads(done.stdout.splitlines()[-1])
    return rates


def figures_of(measured: Mapping[str, Mapping[str, float]]) -> list[Figure]:
    """Rates in simulated time, so that control rates compare: steps per CPU second over the control rate."""
    rows: list[Figure] = []
    for name, rates in measured.items():
        base = BESIDE.get(name, GRS)
        for kind in (kind for kind in ("steps", "pictures", "resets") if kind in rates):
            unit = "per CPU s" if kind == "resets" else "simulated s per CPU s"
            value, reference = (
                of[kind] if kind == "resets" else of[kind] / of["hertz"] for of in (rates, measured[base])
            )
            rows.append(Figure(name=f"{name}: {kind}", value=value, unit=unit, smaller_is_better=False))
            if name != GRS:
                target = {FINGERS: 2.0, LIFT: 5.0}.get(name) if kind == "steps" else None
                ratio = f"{base} over {name}: {kind}"
                upper = name == FINGERS
                rows.append(
                    Figure(name=ratio, value=reference / value, target=target, unit="times", smaller_is_better=upper)
                )
    return rows


def main(arguments: Sequence[str]) -> int:
    """Measure and print.

    Returns:
        0 if every target is kept, 1 if not.
    """
    from grs_agents.runs.experiment_run import ExperimentParser
    from grs_agents.runs.experiments import positive_int

    parser = ExperimentParser("peer_speed", __doc__)
    folders = ", ".join(sorted({peer.venv for peer in PEERS.values()}))
    parser.add_argument("--venvs", type=Path, metavar="DIR", help=f"holds a venv each for any of {folders}")
    parser.add_argument("--steps", type=positive_int, default=500, help="steps of each timing")
    parser.add_argument("--size", type=positive_int, default=128, help="pixels across a square picture")
    experiment = parser.start(arguments)
    options = experiment.options
    steps, size, venvs = int(options.steps), int(options.size), Path(options.venvs) if options.venvs else None
    if venvs is not None and not venvs.is_dir():
        raise ConfigError(f"--venvs {venvs} is no folder", "make a venv in it for each peer, named as --help says")
    measured = {GRS: measure_grs(steps, size), FINGERS: measure_grs(steps, size, robot="panda", hand="franka_hand")}
    for name, peer in PEERS.items():
        if venvs is not None and (python := venvs / peer.venv / "bin" / "python").exists():
            measured[name] = measure_peer(name, str(python), steps, size)
    return experiment.tell_figures("environment speed beside peers", figures_of(measured))
