"""Many sandbox calls, failing calls among them: leaks, and reproducibility of their results."""

import json
import os
import random
import signal
import tempfile
import time
from collections import Counter
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path

from grs_agents.base import Frozen, content
from grs_agents.base.config.schema import Config, Limits
from grs_agents.base.terminal import print_escaped
from grs_agents.runs.experiment_run import ExperimentParser, show_progress
from grs_agents.runs.experiments import positive_int, terminal_table
from grs_agents.runs.sandbox_setup import open_sandbox
from grs_agents.sandbox.host.sandbox import Sandbox

TOOL = """
from grs_agents import sandbox, sim

def inside(request):
    if request["code"]:
        exec(request["code"], {})
        return {}
    task = sim.find_task_class(sandbox.load_program(request["simulation"]))()
    done = sim.rollout(sim.instantiate(task, request["seed"]))
    return {"reward": done.episode.reward, "final": sorted(done.final.items())}
"""
SIMULATION = """
import numpy as np
from grs_agents.sim import Task

class PutBlockInBowl(Task):
    def __init__(self):
        super().__init__()
        self.max_steps, self.pos_eps = 3, 0.05
        self.lang_template = "put the red block into the green bowl"
        self.task_completed_desc = "done."
        self.additional_reset()

    def reset(self, env):
        super().reset(env)
        pose = self.get_random_pose(env, (0.12, 0.12, 0.06))
        env.add_object("bowl/bowl.urdf", pose, "fixed")
        block = env.add_object("block/red_block.urdf", self.get_random_pose(env, (0.04, 0.04, 0.04)))
        self.add_goal(objs=[block], matches=np.ones((1, 1)), targ_poses=[pose], replace=False, rotations=True,
                      metric='pose', params=None, step_max_reward=1.0, symmetries=[np.pi / 2],
                      language_goal=self.lang_template)
"""
FAILURES = {
    "crashed": "import ctypes; ctypes.string_at(0)",
    "error": "raise ValueError",
    "timeout": "while True: pass",
    "memory_limit": "kept = []\nwhile True: kept.append(bytearray(1 << 24))",
    "scratch_limit": "open('file', 'wb').write(b'x' * (100 << 20))",
    "output_limit": "while True: print('x' * 100000)",
}
LIMITS = {"timeout": Limits(wall_seconds=0.3)}


class Figures(Frozen):
    """The figures of a soak test.

    Attributes:
        calls: their number.
        outcomes: of the calls.
        unexpected: calls with an unexpected outcome, a line each.
        kills: number of kills of the forking process by the test itself, after each of which a call was repeated.
        rewards_differ: seeds with different results among the calls.
        descriptors, processes, scratch: present at the end and absent at the beginning.
        memory_mib: growth of this process from the first tenth to the end.
        seconds: wall time.
    """

    calls: int
    outcomes: dict[str, int]
    unexpected: tuple[str, ...]
    kills: int
    rewards_differ: tuple[int, ...]
    descriptors: int
    processes: int
    scratch: int
    memory_mib: float
    seconds: float

    @property
    def clean(self) -> bool:
        """True if nothing was left, and every call ended as expected."""
        left = self.descriptors or self.processes or self.scratch
        return not (self.unexpected or self.rewards_differ or left or self.memory_mib > 10)


def soak(calls: int, seed: int, config: Config) -> Figures:
    """Make ``calls`` calls: half of them simulations, the others failures; every hundredth loses its zygote."""
    rng = random.Random(seed)
    outcomes: Counter[str] = Counter()
    unexpected: list[str] = []
    results: dict[int, set[str]] = {}
    started, kills, memory = time.monotonic(), 0, 0.0
    with tempfile.TemporaryDirectory(prefix="grs-soak-") as name:
        overlay, temporary = Path(name) / "content", Path(name) / "temporary"
        (overlay / "tools").mkdir(parents=True)
        (overlay / "tools" / "soak.py").write_text(TOOL, "utf-8")
        content.add_overlay_folder(overlay)
        temporary.mkdir()
        tempfile.tempdir = str(temporary)  # other runs on this machine have scratch folders too
        before = _held()
        with open_sandbox(config) as sandbox, show_progress("calls", calls) as advance:
            for number in range(calls):
                if number == calls // 10:
                    memory = _memory_mib()
                if number % 100 == 99:
                    kills += _kill_forking_process()
                wanted = "ok" if rng.random() < 0.5 else rng.choice(list(FAILURES))
                ended, result = _call(sandbox, wanted, rng.randrange(5), results)
                outcomes[ended] += 1
                advance("calls", "")
                if ended != wanted:
                    unexpected.append(f"call {number}: {ended} instead of {wanted}: {result}")
        after = _held()
        tempfile.tempdir = None
    return Figures(
        calls=calls,
        outcomes=dict(outcomes),
        unexpected=tuple(unexpected),
        kills=kills,
        rewards_differ=tuple(seed for seed, values in results.items() if len(values) > 1),
        descriptors=after[0] - before[0],
        processes=after[1] - before[1],
        scratch=after[2] - before[2],
        memory_mib=_memory_mib() - memory,
        seconds=time.monotonic() - started,
    )


def _call(sandbox: Sandbox, wanted: str, seed: int, results: dict[int, set[str]]) -> tuple[str, str]:
    request = {"code": FAILURES.get(wanted, ""), "simulation": SIMULATION, "seed": seed}
    result = sandbox.call("soak", request, LIMITS.get(wanted))
    if result.outcome == "ok" and wanted == "ok":
        results.setdefault(seed, set()).add(json.dumps(result.value))
    return result.outcome, (result.error.strip().splitlines() or [""])[-1]


def _children() -> list[int]:
    return [int(pid) for pid in Path(f"/proc/self/task/{os.getpid()}/children").read_text("ascii").split()]


def _kill_forking_process() -> int:
    for pid in _children():
        with suppress(ProcessLookupError, PermissionError):
            os.killpg(pid, signal.SIGKILL)
            return 1
    return 0


def _held() -> tuple[int, int, int]:
    """Open descriptors, child processes and scratch folders of this process."""
    scratch = list(Path(tempfile.gettempdir()).glob("grs-scratch-*"))
    return len(list(Path("/proc/self/fd").iterdir())), len(_children()), len(scratch)


def _memory_mib() -> float:
    pages = int(Path("/proc/self/statm").read_text("ascii").split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / (1 << 20)


def main(arguments: Sequence[str]) -> int:
    """Soak and print; 0 if nothing was left behind and every call ended as it should."""
    parser = ExperimentParser("sandbox_soak", __doc__)
    parser.add_argument("--calls", type=positive_int, default=1000, help="how many calls to make")
    parser.add_argument("--seed", type=int, default=0, help="which calls they are")
    experiment = parser.start(arguments)
    calls, seed = experiment.options.calls, experiment.options.seed
    # a single row: leaks show in a single process only
    (figures,) = experiment.make_or_reuse_rows(Figures, {"soak": lambda: soak(calls, seed, experiment.config)})
    rows = [{"what": name, "found": str(value)} for name, value in figures.model_dump().items()]
    title = "clean" if figures.clean else "not clean"
    experiment.tell(rows, terminal_table(title, ("what", "found"), rows), **figures.model_dump(), clean=figures.clean)
    if not figures.clean:
        print_escaped("grs: the sandbox left something behind or a call ended otherwise than it should", error=True)
    return 0 if figures.clean else 1
