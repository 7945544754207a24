"""A small run as the nodes would write it: the sample scene, one fix, one rollout of library assets."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from grs_agents.base import content
from grs_agents.base.trace.events import (
    Decision,
    Finding,
    NodeEnded,
    NodeStarted,
    Note,
    ProgramVersion,
    Prompt,
    Reply,
    Rollout,
    RunEnded,
    RunStarted,
    SceneStage,
    TaskDefined,
    TestsRun,
)
from grs_agents.base.trace.log import EventLog
from grs_agents.library.library import Library
from grs_agents.sim.instance.goal import Goal
from grs_agents.sim.instance.task_instance import InstanceObject, TaskInstance
from grs_agents.sim.world.bystanders import FIRST_BYSTANDER

ASSETS = ("HOPE/Milk.urdf", "HOPE/Cookies.urdf", "block/red_block.urdf", "bowl/bowl.urdf")
UNIT = (0.0, 0.0, 0.0, 1.0)
FIRST = "class Packing(Task):\n    def reset(self, env):\n        self.max_steps = 1\n"
SECOND = FIRST.replace("= 1", "= 4")
DIFF = (
    "--- a\n+++ b\n@@ -1,3 +1,3 @@\n class Packing(Task):\n-        self.max_steps = 1\n+        self.max_steps = 4\n"
)


@pytest.fixture(scope="session")
def library() -> Library:
    """The library that ships with GRS."""
    return Library()


def write_scene(folder: Path) -> SceneStage:
    """Link the sample scene into ``folder``; the stage with its camera, masks and two boxes."""
    source = content.content_path("assets", "scenes") / "groceries"
    for name in ("rgb.png", "depth.png", "labels.png"):
        (folder / name).write_bytes((source / name).read_bytes())
    stands = {"asset": "HOPE/Milk.urdf", "position": [0.435, 0.135, 0.095], "orientation": list(UNIT)}
    boxes = [
        {"id": 1, "name": "milk_1", "box": {"low": [0.4, 0.1, 0.0], "high": [0.47, 0.17, 0.19]}, **stands},
        {"id": 2, "name": "cookies_1 \N{COOKIE}", "box": {"low": [0.5, -0.2, 0.0], "high": [0.6, -0.1, 0.06]}},
    ]
    return SceneStage(
        stage="matched",
        summary={"camera": json.loads((source / "camera.json").read_text()), "objects": boxes},
        files={"rgb": "rgb.png", "depth": "depth.png", "masks": "labels.png"},
    )


def write_rollout(folder: Path, seed: int, seconds: float = 4.0) -> Rollout:
    """A made-up rollout in which the first object is carried; the instance names library assets."""
    objects = tuple(
        InstanceObject(id=number, asset=asset, pose=((0.35 + 0.12 * number, 0.1 * number - 0.2, 0.08), UNIT))
        for number, asset in enumerate(ASSETS)
    )
    others = {"id": FIRST_BYSTANDER + 1, "role": "bystander"}  # it stands for the second object of the scene
    objects = (*objects[:-1], objects[-1].model_copy(update=others))
    goal = Goal(
        objects=(0,),
        matches=((1,),),
        targets=(((0.6, 0.3, 0.08), UNIT),),
        replace=False,
        rotations=False,
        metric="pose",
        max_reward=1.0,
        symmetries=(0.0,),
        language="put the milk on the left",
    )
    instance = TaskInstance(task="Packing", seed=seed, max_steps=4, timestep=0.002, objects=objects, goals=(goal,))
    (folder / "instances").mkdir(exist_ok=True)
    (folder / f"instances/seed_{seed}.json").write_text(instance.model_dump_json())
    times = np.arange(0, seconds, 0.02)
    share = times / seconds
    poses = np.repeat(np.array([item.pose[0] for item in objects])[None], len(times), axis=0)
    poses[:, 0] += np.outer(share, [0.2, 0.4, 0]) + np.outer(np.sin(np.pi * share), [0, 0, 0.2])
    tool = poses[:, 0] + [0, 0, 0.12]
    chain = np.stack([tool * part + [0, 0, 0.5 * np.sin(np.pi * part)] for part in np.linspace(0, 1, 7)], axis=1)
    positions = np.concatenate([poses, chain], axis=1)
    quaternions = np.tile(np.array(UNIT), (*positions.shape[:2], 1))
    names = [f"object_{item.id}" for item in objects] + [f"link_{number}" for number in range(7)]
    recording = f"instances/seed_{seed}.npz"
    np.savez_compressed(
        folder / recording,
        times=times,
        names=np.array(names),
        positions=positions,
        quaternions=quaternions,
        tool=tool,
    )
    return Rollout(
        seed=seed,
        reward=1.0,
        outcome="success",
        steps=1,
        moved=("HOPE/Milk.urdf",),
        recording=recording,
        instance=f"instances/seed_{seed}.json",
    )


def report(passed: bool) -> dict[str, Any]:
    """A test report of two cases."""
    case: dict[str, Any] = {"id": "TestPacking.test_bounds", "outcome": "passed", "seconds": 0.01, "message": ""}
    oracle: dict[str, Any] = {**case, "id": "TestPacking.test_oracle", "seconds": 1.2}
    if not passed:
        episode = {"outcome": "step_limit", "reward": 0.25, "detail": "1 of 4 objects placed | max_steps=1"}
        trace = 'Traceback:\n  File "test.py", line 9\nAssertionError: 0.25 < 0.99'
        oracle |= {"outcome": "failed", "message": "0.25 < 0.99", "traceback": trace, "episode": episode}
    return {"outcome": "passed" if passed else "failed", "cases": [case, oracle], "message": ""}


def program(folder: Path, number: int, text: str, **more: Any) -> ProgramVersion:
    """Write a version of the simulation program."""
    (folder / "history").mkdir(exist_ok=True)
    path = f"history/simulation_{number}.py"
    (folder / path).write_text(text)
    return ProgramVersion(program="simulation", number=number, sha256=f"{number:064d}", path=path, **more)


class Script:
    """The run, node by node, into one log."""

    def __init__(self, log: EventLog, folder: Path) -> None:
        self.log, self.folder = log, folder

    def node(self, name: str, visit: int, *events: Any, seconds: float = 0.5) -> None:
        """One visit of a node with what happens in it."""
        self.log.append(NodeStarted(node=name, visit=visit))
        for event in events:
            self.log.append(event)
        self.log.append(NodeEnded(node=name, seconds=seconds, changed=("state",)))

    def call(self, role: str, text: str, *, image: bool = False) -> tuple[Prompt, Reply]:
        """A model call."""
        images = ("rgb.png",) if image else ()
        asked = Prompt(call=f"{role}-1", role=role, model="offline", text=f"# Role: {role}\n\n{text}", images=images)
        told = Reply(
            call=f"{role}-1",
            role=role,
            model="offline",
            text=f"```python\n{SECOND}```",
            input_tokens=900,
            output_tokens=120,
            seconds=0.8,
            finish_reason="stop",
        )
        return asked, told

    def before_fix(self) -> None:
        """Photo to the first failing test run and the decision."""
        self.log.append(RunStarted(run_id="sample-run", graph="grs", seed=0, config={"max_fixes": 10}))
        self.node("segment", 1, write_scene(self.folder))
        task = {"task-name": "pack-milk", "task-description": "Put the milk away.", "assets-used": list(ASSETS)}
        self.node("generate_task", 1, *self.call("task", "## Scene", image=True), TaskDefined(task=task))
        first = program(self.folder, 1, FIRST, author_role="simulation")
        self.node("generate_sim", 1, *self.call("simulation", "## Task \N{PARTY POPPER}", image=True), first)
        self.node("run_tests", 1, TestsRun(report=report(False)))
        reason = "The oracle used up max_steps=1 with 1 of 4 objects placed, so the program is at fault."
        self.node("route", 1, Decision(verdict="fix_code", explanation=reason, policy="llm"))

    def after_fix(self, seconds: float = 4.0) -> None:
        """The fix, passing tests, audit with rollouts of so many seconds, and verdict."""
        self.log.attempt = 1
        second = program(self.folder, 2, SECOND, author_role="fix_code", parent=f"{1:064d}", diff=DIFF)
        self.node("fix_code", 1, *self.call("fix_code", "## Test report"), second)
        self.node("run_tests", 2, TestsRun(report=report(True)))
        rollouts = [write_rollout(self.folder, seed, seconds) for seed in range(2)]
        findings = (Finding(check="reward", passed=True, measured="1.00 on 2 of 2 seeds"), Note(text="all well"))
        self.node("audit", 1, *rollouts, *findings, seconds=2.0)
        self.log.append(RunEnded(status="accepted", reason="every check passed"))


@pytest.fixture
def script(tmp_path: Path) -> Callable[[], Script]:
    """Opens the log of a run in ``tmp_path``, again after a crash."""
    return lambda: Script(EventLog(tmp_path / "events.jsonl"), tmp_path)
