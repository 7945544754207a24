"""The reason of a rejected program is what happened on the table."""

import json
from pathlib import Path
from typing import Any

import pytest

from grs_agents.graph.rejection import explain_rejection
from grs_agents.sandbox.protocol.report import TestReport
from tests.cli.command import grs

PROGRAM = """\
import numpy as np
from grs_agents.sim import Task


class Move(Task):
    def __init__(self):
        super().__init__()
        self.max_steps = 1
        self.lang_template = "move it"
        self.additional_reset()

    def reset(self, env):
        super().reset(env)
        flat = (0, 0, 0, 1)
        starts, targets = {starts}, {targets}
        blocks = [env.add_object(f"block/{{color}}_block.urdf", start and ((*start, 0.02), flat))
                  for color, start in zip(("red", "blue"), starts)]
        if targets:
            targets = [((*target, 0.02), flat) for target in targets]
            self.add_goal(blocks, np.eye(len(blocks)), targets, False, True, "pose", None, 1, [np.pi / 2])
"""
NEAR, ASIDE, FAR = (0.45, 0.1), (0.45, -0.2), (0.95, 0.4)


@pytest.mark.parametrize(
    ("starts", "targets", "reason"),
    [
        ([FAR], [NEAR], "the red block #1 at (0.95, 0.40, 0.02) is 1.03 m from the base, reach is 0.85 m"),
        ([NEAR], [FAR], "target of the red block #1 at (0.95, 0.40, 0.02) is 1.03 m from the base"),
        ([NEAR], [NEAR], "at its target already"),
        (
            [NEAR, ASIDE],
            [(0.5, 0.3), (0.5, -0.3)],
            "the red block #1 is 0.206 m from its target at (0.500, 0.300, 0.020), 0.01 m are allowed; all 1 actions",
        ),
        ([NEAR], [], "the task states no goal"),
        ([None], [NEAR], "no free place was found"),
        ("1 / 0", [], "ZeroDivisionError: division by zero"),
    ],
)
def test_a_rejected_program_is_told_the_physical_reason(tmp_path: Path, starts: Any, targets: Any, reason: str) -> None:
    (tmp_path / "move.py").write_text(PROGRAM.format(starts=starts, targets=targets))
    done = grs("check", "move.py", "--set", "audit.seeds=1", "--json", folder=tmp_path)
    assert reason in json.loads(done.stdout)["reason"], done.stdout


EPISODE: dict[str, Any] = {"outcome": "success", "reward": 1, "steps": 1, "max_steps": 3, "detail": "every goal met"}
TIPPED = "HOPE/Milk.urdf (0.98 kg) tipped off the cup: 0.27 N m bent it, it bears 0.15 N m"
PICK = {"object": 1, "asset": "HOPE/Milk.urdf", "pick": (0.5, 0, 0.2), "place": (0.4, 0, 0.2), "reward": 0}
DROPPED = {
    **EPISODE,
    "outcome": "dropped",
    "detail": f"HOPE/Milk.urdf #1 was not brought to its target, it is at (0.5, 0.0, 0.1); last: {TIPPED}",
    "actions": [{**PICK, "note": TIPPED, "trouble": "dropped"}],
}
TRACEBACK = 'Traceback:\n  File "test_task_code.py", line 54, in test_it\n    self.assertTrue(done)\n'


@pytest.mark.parametrize(
    ("message", "traceback", "episode", "reason"),
    [
        (
            "AssertionError: np.False_ is not true",
            TRACEBACK,
            DROPPED,
            "the milk (0.98 kg) tipped off the cup: 0.27 N m",
        ),
        (
            "AssertionError: np.False_ is not true",
            TRACEBACK,
            EPISODE,
            "the robot meets every goal, yet test_it: it fails at line 54 of the tests: self.assertTrue(done)",
        ),
        ("AssertionError: 1 != 2 : too few blocks", TRACEBACK, None, "test_it: too few blocks"),
        ("AssertionError: 1 != 2", "", None, "test_it: 1 != 2"),
        ("KeyError: 0", TRACEBACK, {"outcome": "anything"}, "test_it: KeyError: 0 at line 54 of the tests"),
    ],
)
def test_a_failed_test_is_told_by_its_episode_before_its_assertion(
    message: str, traceback: str, episode: Any, reason: str
) -> None:
    case = {"id": "T.test_it", "outcome": "failed", "message": message, "traceback": traceback, "episode": episode}
    report = TestReport.model_validate({"outcome": "failed", "cases": [case]})
    assert explain_rejection(report, None).startswith(reason)


@pytest.mark.parametrize("letters", ["a", "a/", "a.", "/a", "a.xml", "grs_agents."])
def test_a_reason_of_a_million_letters_is_read_and_cut(letters: str) -> None:
    message = f"KeyError: block/red_block.urdf {letters * 1_000_000}"
    case = {"id": "T.test_it", "outcome": "failed", "message": message, "traceback": "", "episode": None}
    report = TestReport.model_validate({"outcome": "failed", "cases": [case]})
    reason = explain_rejection(report, None)
    assert reason.startswith("test_it: KeyError: the red block ") and len(reason) <= 403


@pytest.mark.parametrize(
    ("message", "line"),
    [
        ("ValueError: too many", 'tuna, box = self.env.obj_ids["rigid"]'),
        ("UnknownNameError: unknown asset 'HOPE/Tune.urdf'; did you mean HOPE/Tuna.urdf?", "env.find(name)"),
    ],
)
def test_code_and_names_of_the_library_are_quoted_as_they_are(message: str, line: str) -> None:
    traceback = f'  File "test_task_code.py", line 3, in test_a\n    {line}\n{message}'
    failed = {"id": "T.test_a", "outcome": "error", "message": message, "traceback": traceback, "raised_in": "tests"}
    report = TestReport.model_validate({"outcome": "error", "cases": [failed]})
    assert explain_rejection(report, None) == f"test_a: {message} at line 3 of the tests: {line}"
