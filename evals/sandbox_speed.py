"""Overhead of isolation against the same work in a single process: CPU, beside a cold ``unittest``; start; memory."""

import resource
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from pathlib import Path

from grs_agents.base import content
from grs_agents.base.config.schema import Config, Limits
from grs_agents.library.library import Library
from grs_agents.runs.experiment_run import ExperimentParser
from grs_agents.runs.experiments import positive_int
from grs_agents.runs.metrics import Figure, cpu_seconds
from grs_agents.runs.sandbox_setup import PRELOAD, TOOLS, open_sandbox
from grs_agents.sandbox.host.sandbox import Sandbox
from grs_agents.toolkit import ToolContext, load_tool

SIMULATION = """
import numpy as np
from grs_agents.sim import Task

class StackBlocks(Task):
    def __init__(self):
        super().__init__()
        self.max_steps = 3
        self.lang_template = "put the red block on the blue block"
        self.task_completed_desc = "done stacking."
        self.additional_reset()

    def reset(self, env):
        super().reset(env)
        base = ((0.5, 0.1, 0.02), (0, 0, 0, 1))
        env.add_object("block/blue_block.urdf", base)
        red = env.add_object("block/red_block.urdf", self.get_random_pose(env, (0.04, 0.04, 0.04)))
        self.add_goal(objs=[red], matches=np.ones((1, 1)), targ_poses=[((0.5, 0.1, 0.06), (0, 0, 0, 1))],
                      replace=False, rotations=False, metric='pose', params=None, step_max_reward=1.0,
                      symmetries=[np.pi / 2], language_goal=self.lang_template)
"""
TESTS = """
import unittest
from grs_agents.sim import Environment
from task_code import StackBlocks

class TestStackBlocks(unittest.TestCase):
    def setUp(self):
        self.env = Environment(None)
        self.task = StackBlocks()
        self.env.set_task(self.task)
        self.env.reset()

    def test_objects(self):
        self.assertEqual(len(self.env.obj_ids["rigid"]), 2)

    def test_no_reward_at_first(self):
        self.assertEqual(self.task.progress, 0)

    def test_oracle(self):
        agent = self.task.oracle(self.env)
        done = False
        while not done:
            _, _, done, _ = self.env.step(agent.act())
        self.assertGreater(self.task.progress, 0.99)
"""
IN_PROCESS = """
import importlib, os, sys, time, unittest
for name in {preload!r}:
    importlib.import_module(name)
sys.path.insert(0, ".")
start = time.process_time()
tests = unittest.defaultTestLoader.loadTestsFromName("test_task_code")
result = unittest.TextTestRunner(stream=open(os.devnull, "w")).run(tests)
print(time.process_time() - start if result.wasSuccessful() and result.testsRun == 3 else "failed")
"""
ROLLOUT = """
import resource
from grs_agents import sandbox, sim

def inside(request):
    task = sim.find_task_class(sandbox.load_program(request["simulation"]))()
    done = sim.rollout(sim.instantiate(task, 0))
    assert done.episode.outcome == "success"
    return {"pages": resource.getrusage(resource.RUSAGE_SELF).ru_minflt}
"""
_EMPTY_CALLS = 60
"""Enough calls to outweigh the noise of the two starts."""
EMPTY = "def inside(request):\n    return {}\n"


def cold(folder: Path) -> float:
    """CPU time of ``python -m unittest``, s."""
    start = cpu_seconds()
    subprocess.run([sys.executable, "-m", "unittest", "test_task_code"], cwd=folder, check=True, capture_output=True)
    return cpu_seconds() - start


def in_process(folder: Path) -> float:
    """CPU time of the tests in a process that has its imports done and nothing else, s."""
    code = IN_PROCESS.format(preload=PRELOAD)
    done = subprocess.run([sys.executable, "-c", code], cwd=folder, check=True, capture_output=True, text=True)
    return float(done.stdout)


def per_call(call: Callable[[Sandbox], object], calls: int, tools: Sequence[str] = TOOLS) -> float:
    """CPU time of a call in host, forking process and worker together, s.

    Two sandboxes with ``calls`` and twice as many calls differ by just that, and their start cancels out. The
    backend is ``landlock``: bubblewrap is idle during a call, and hides the CPU time of its processes from the
    host.
    """
    taken: list[float] = []
    for count in (calls, 2 * calls):
        start = cpu_seconds()
        with Sandbox(PRELOAD, tools=tools, backend="landlock") as sandbox:
            for _ in range(count):
                call(sandbox)
        taken.append(cpu_seconds() - start)
    return (taken[1] - taken[0]) / calls


def start_seconds(config: Config) -> float:
    """Wall time from nothing to the end of the first call, s."""
    start = time.perf_counter()
    with open_sandbox(config) as sandbox:
        sandbox.call("empty", {})
        return time.perf_counter() - start


def run_tests(sandbox: Sandbox) -> None:
    """The warm call."""
    tool = load_tool("run_tests")
    context = ToolContext(sandbox=sandbox, library=Library(), limits=Limits())
    report = tool.run(tool.Request(simulation=SIMULATION, tests=TESTS), context).report
    if not report.all_passed:
        raise RuntimeError(str(report))


def worker_mib(config: Config) -> float:
    """Memory that a worker takes for itself while it instantiates and solves a task: every page it touched, MiB."""
    with open_sandbox(config) as sandbox:
        result = sandbox.call("rollout_alone", {"simulation": SIMULATION})
    if result.value is None:
        raise RuntimeError(result.error)
    return float(result.value["pages"] * resource.getpagesize() / (1 << 20))


def measure_calls(folder: Path, repeats: int) -> list[Figure]:
    """The same tests cold, in a process with its imports done, and in a warm sandbox."""
    rounds = [(cold(folder), in_process(folder), per_call(run_tests, 5)) for _ in range(repeats)]
    ratios = [(warm - plain) / (whole - plain) for whole, plain, warm in rounds]
    whole, plain, warm = (1000 * statistics.median(column) for column in zip(*rounds, strict=True))
    return [
        Figure(name="overhead of a warm call / of a cold one", value=statistics.median(ratios), target=1 / 8, unit=""),
        Figure(name="cold python -m unittest", value=whole, unit="ms"),
        Figure(name="the three tests in one process", value=plain, unit="ms"),
        Figure(name="warm call of the three tests", value=warm, unit="ms"),
    ]


def measurements(folder: Path, config: Config, repeats: int) -> dict[str, Callable[[], Sequence[Figure]]]:
    """All figures, medians of ``repeats`` measurements."""

    def measure_empty_call() -> list[Figure]:
        empty = statistics.median(
            per_call(lambda sandbox: sandbox.call("empty", {}), _EMPTY_CALLS, (*TOOLS, "empty")) for _ in range(repeats)
        )
        return [Figure(name="empty call", value=1000 * empty, target=15, unit="ms")]

    def measure_start() -> list[Figure]:
        start = statistics.median(start_seconds(config) for _ in range(repeats))
        return [Figure(name="start to the end of the first call", value=start, target=1.5, unit="s")]

    def measure_memory() -> list[Figure]:
        memory = statistics.median(worker_mib(config) for _ in range(repeats))
        return [Figure(name="a second worker", value=memory, target=40, unit="MiB")]

    calls = {"calls": lambda: measure_calls(folder, repeats)}
    return {**calls, "empty call": measure_empty_call, "start": measure_start, "memory": measure_memory}


def main(arguments: Sequence[str]) -> int:
    """Measure and print.

    Returns:
        0 if every target is kept, 1 if not.
    """
    parser = ExperimentParser("sandbox_speed", __doc__)
    parser.add_argument("--repeats", type=positive_int, default=5, help="measurements of each figure")
    experiment = parser.start(arguments)
    with tempfile.TemporaryDirectory(prefix="grs-eval-") as name:
        folder = Path(name)
        (folder / "task_code.py").write_text(SIMULATION, "utf-8")
        (folder / "test_task_code.py").write_text(TESTS, "utf-8")
        (folder / "tools").mkdir()
        (folder / "tools" / "rollout_alone.py").write_text(ROLLOUT, "utf-8")
        (folder / "tools" / "empty.py").write_text(EMPTY, "utf-8")
        content.add_overlay_folder(folder)
        figures = experiment.measure(measurements(folder, experiment.config, experiment.options.repeats))
    return experiment.tell_figures("sandbox", figures)
