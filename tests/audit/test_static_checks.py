"""What shows in the two programs without a run; right programs show nothing."""

import random
import re

import pytest

from grs_agents.agents.types import TaskDefinition
from grs_agents.audit.static_checks import check_programs
from grs_agents.base import content
from grs_agents.library.library import Library

TASK = TaskDefinition.model_validate(
    {
        "task-name": "pack-two-cans",
        "task-description": "Put both cans into the box.",
        "assets-used": ["HOPE/Corn.urdf", "HOPE/Tuna.urdf", "container/open_box.urdf"],
    }
)
SIMULATION = """\
from grs_agents.sim import Task, inside, utils


class PackTwoCans(Task):
    def reset(self, env):
        super().reset(env)
        box = env.add_object("container/open_box.urdf", ((0.5, 0.2, 0.045), (0, 0, 0, 1)), "fixed")
        corn = env.add_object("HOPE/Corn.urdf", ((0.5, -0.2, 0.03), utils.eulerXYZ_to_quatXYZW((0, 0, 1))))
        tuna = env.add_object("HOPE/Tuna.urdf", self.get_random_pose(env, (0.08, 0.08, 0.04)))
        self.add_goal(inside([corn], box), step_max_reward=1 / 2, language_goal="corn")
        self.add_goal(inside([tuna], box), step_max_reward=0.5, language_goal="tuna")
"""
TESTS = """\
import unittest
from grs_agents.sim import Environment
from task_code import PackTwoCans


class TestPackTwoCans(unittest.TestCase):
    def test_goals(self):
        env = Environment(None)
        task = PackTwoCans()
        env.set_task(task)
        env.reset()
        self.check(len(task.goals))

    def check(self, count):
        self.assertEqual(count, 2)
"""


def found(simulation: str = SIMULATION, tests: str = TESTS) -> list[tuple[str, str, int]]:
    """Program, kind and line of each finding."""
    return [(item.program, item.kind, item.line) for item in check_programs(simulation, tests, TASK, Library())]


def test_right_programs_show_nothing() -> None:
    assert found() == []


@pytest.mark.parametrize(
    ("right", "wrong", "kind", "line"),
    [
        ("class PackTwoCans(Task):", "class PackTwoCans(Task)", "syntax", 4),
        ("inside, utils", "inside, util", "import", 1),
        ("from grs_agents.sim", "import subprocess\nfrom grs_agents.sim", "import", 1),
        ("from grs_agents.sim", "import sim_tools\nfrom grs_agents.sim", "import", 1),
        ("Task, inside, utils", "Task, utils", "unknown_name", 10),
        ("utils.eulerXYZ_to_quatXYZW", "utils.euler_to_quat", "unknown_name", 8),
        ('env.add_object("HOPE/Tuna', 'env.append_object("HOPE/Tuna', "unknown_name", 9),
        ('language_goal="corn"', 'goal_text="corn"', "unknown_argument", 10),
        ("env, (0.08, 0.08, 0.04)", "env", "wrong_arguments", 9),
        ("inside([corn], box)", "inside([corn], box, 1)", "wrong_arguments", 10),
        ("        super()", "        while True:\n            pass\n        super()", "endless_loop", 6),
        ("HOPE/Tuna.urdf", "HOPE/TunaCan.urdf", "unknown_asset", 9),
        ("HOPE/Tuna.urdf", "HOPE/Mushrooms.urdf", "asset_not_in_task", 9),
        ("HOPE/Tuna.urdf", "HOPE/Corn.urdf", "asset_unused", 1),
        ("inside([tuna], box)", "inside([corn], box)", "object_without_goal", 9),
        ("step_max_reward=0.5", "step_max_reward=0.25", "reward_sum", 11),
        ("super().reset(env)", "pass", "base_call_missing", 5),
        ("class PackTwoCans(Task)", "class PackCans(Task)", "class_missing", 4),
        ("PackTwoCans(Task)", "PackTwoCans(object)", "class_missing", 1),
    ],
)
def test_faults_of_the_program(right: str, wrong: str, kind: str, line: int) -> None:
    assert right in SIMULATION
    assert ("simulation", kind, line) in found(SIMULATION.replace(right, wrong))


@pytest.mark.parametrize(
    ("right", "wrong", "kind", "line"),
    [
        ("self.check(len(task.goals))", "self.check(len(task.goals)", "syntax", 12),
        ("import PackTwoCans", "import PackTwoCan", "class_missing", 3),
        ("env.set_task(task)", "env.use_task(task)", "unknown_name", 10),
        ("env.reset()", "env.reset(task)", "", 0),
        ("env.reset()", "env.reset(seed=3)", "unknown_argument", 11),
        ("self.check(len(task.goals))", "print(task)", "no_assertion", 7),
        ("def test_goals", "def goals", "no_tests", 1),
        ("task = PackTwoCans()", "task = TheTask()", "unknown_name", 9),
    ],
)
def test_faults_of_the_tests(right: str, wrong: str, kind: str, line: int) -> None:
    assert right in TESTS
    expected = [("tests", kind, line)] if kind else []
    assert found(tests=TESTS.replace(right, wrong))[:1] == expected


def test_a_message_names_the_nearest_right_names() -> None:
    [finding] = check_programs(SIMULATION.replace("language_goal", "language_gaol"), TESTS, TASK, Library())[:1]
    assert "language_goal" in finding.message
    findings = check_programs(SIMULATION.replace("HOPE/Tuna", "HOPE/Tune"), TESTS, TASK, Library())
    assert "HOPE/Tuna.urdf" in next(item.message for item in findings if item.kind == "unknown_asset")


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("x = np.ones(1)", "np is not defined; `import numpy as np` is missing"),
        ("x = math.pi", "math is not defined; `import math` is missing"),
        ("x = utils.COLORS", "utils is not defined; `from grs_agents.sim import utils` is missing"),
        ("x = token", "token is not defined; did you mean open"),
    ],
)
def test_a_missing_import_is_named(line: str, message: str) -> None:
    text = re.sub(r"^(?:import numpy as np|import math)\n", "", SIMULATION, flags=re.M).replace(", utils", "")
    findings = check_programs(f"p = 1\n{text}\n{line}\n", TESTS, TASK, Library())
    assert message in [finding.message for finding in findings]


def test_an_unknown_asset_has_a_nearest_name_however_far() -> None:
    far = check_programs(SIMULATION.replace("HOPE/Tuna.urdf", "q/zzz.urdf"), TESTS, TASK, Library())
    assert re.search(r"nearest are \w\S+\.urdf, ", next(item.message for item in far if item.kind == "unknown_asset"))
    other = check_programs(SIMULATION.replace("HOPE/Tuna.urdf", "HOPE/Mustard.urdf"), TESTS, TASK, Library())
    assert "the nearest of which is HOPE/" in next(item.message for item in other if item.kind == "asset_not_in_task")


@pytest.mark.parametrize("lines", ['exec("hidden = 1")\nprint(hidden)', "from math import *\nprint(sin(1))"])
def test_names_that_the_source_may_bind_unseen_are_not_reported(lines: str) -> None:
    assert found(f"{SIMULATION}\n\n{lines}\n") == []


def test_the_example_programs_show_nothing_but_another_task() -> None:
    library = Library()
    wrong: list[str] = []
    for file in sorted((content.content_root() / "prompts" / "examples").glob("*.py")):
        findings = check_programs(file.read_text("utf-8"), "", TASK, library)
        wrong += [f"{file.name}: {item}" for item in findings if item.kind not in ("asset_not_in_task", "asset_unused")]
    assert not wrong


def test_no_text_breaks_the_checks() -> None:
    rng = random.Random(0)
    for _ in range(200):
        cut = sorted(rng.randrange(len(SIMULATION)) for _ in range(2))
        broken = SIMULATION[: cut[0]] + SIMULATION[cut[1] :]
        assert all(item.message and item.line >= 1 for item in check_programs(broken, TESTS, TASK, Library()))
    for text in ("", "\0", "(" * 5000, "-" * 100_000 + "1", "x = 1" + "0" * 5000, "\ud800"):
        assert check_programs(text, text, TASK, Library())
