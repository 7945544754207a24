"""The router: what is wrong in the tests as they stand, or asks for more than the task, goes to the tests."""

import pytest

from tests.models.conftest import rich_scene
from tests.models.roles import simulation_for, verdict_on

SOLVED = "== oracle episode (TestX.test_a)\noutcome: success\npublished: 1.00  strict: 1.00  steps: 2/5\ndetail: done"
SHORT = (
    "== tests\nfailed: 1 of 3 tests passed\nTestX.test_a: failed: assertion failed in TestX.test_a: 0.5 != 1.0\n\n"
    "== oracle episode (TestX.test_a)\noutcome: step_limit\npublished: 0.50  strict: 0.50  steps: 3/3\n"
    "detail: step limit: 1 of 2 objects at their goals\nconcerns: HOPE/Milk.urdf"
)
MISUSED = (
    "== tests\nfailed: 2 of 3 tests passed\nTestX.test_a: error (raised in tests): 'dict' object is not callable\n"
    f"  TypeError: 'dict' object is not callable\n\n{SOLVED}"
)
WRONG_COUNT = (
    "== tests\nfailed: 2 of 3 tests passed\nTestX.test_a: failed: assertion failed in TestX.test_a, line 9: 3 != 4\n\n"
    f"{SOLVED}"
)
RAISED = (
    "== tests\nerror: 0 of 0 tests passed; the program cannot be imported\nraised in: simulation\n"
    "  NameError: name 'np' is not defined"
)
IMPORT = (
    "== tests\nerror: 0 of 0 tests passed\nraised in: tests\n  ImportError: cannot import name 'X' from 'task_code'"
)
TIPPED = SHORT.replace(
    "concerns:", "physics: the arm cannot hold HOPE/Milk.urdf there: it tipped off the cup\nconcerns:"
)
WORDS = "== audit\nfailed: 24 of 25 checks hold\n- words: FAILED: not_judged, says m: which cube?"
AUDIT = "== audit\nfailed: 7 of 8 checks hold\n- moved: FAILED: objects moved: [1]; at least 2 must"
HEAD = "== tests\nfailed: 0 of 1 tests passed\n"


@pytest.mark.parametrize(
    ("report", "verdict", "told"),
    [
        (SHORT, "fix_code", "step_limit"),
        (SHORT.replace("step_limit", "stopped"), "fix_test", "0.5 != 1.0"),
        (SHORT.replace("step_limit", "success"), "fix_code", "0.50"),
        (WRONG_COUNT, "fix_test", "3 != 4"),
        (f"== static checks\nsimulation line 7: unknown_asset: no Mlik\n\n{WRONG_COUNT}", "fix_code", "Mlik"),
        (MISUSED, "fix_test", "not callable"),
        (RAISED, "fix_code", "NameError"),
        (IMPORT, "fix_test", "ImportError"),
        (AUDIT, "fix_code", "moved"),
        (TIPPED, "fix_task", "tipped off the cup"),
        (WORDS, "fix_task", "which cube"),
        (WORDS.replace("not_judged", "differ"), "fix_code", "which cube"),
        ("== tests\nno_tests: 0 of 0 tests passed", "fix_test", "no tests"),
        (f"{HEAD}TestX.test_a: no_assertion", "fix_test", "checks nothing"),
        ("== tests\nload_tests: 0 of 0 tests passed", "fix_test", "no tests that count"),
        (f"{HEAD}TestX.test_a: missing (raised in tests): gone", "fix_test", "missing"),
        (f"{HEAD}TestX.test_a: limit (raised in simulation): much", "fix_code", "limit"),
        ("", "fix_code", ""),
    ],
)
def test_verdicts(report: str, verdict: str, told: str) -> None:
    words, explanation = verdict_on(report)
    assert words == verdict
    assert told in explanation


def test_what_the_base_class_would_have_made_is_missed_in_the_program() -> None:
    report = f"{HEAD}TestX.test_a: error (raised in tests): AttributeError: 'Mine' object has no attribute 'ee'"
    code = "class Mine(Task):\n    def __init__(self):\n        self.max_steps = 3\n"
    assert verdict_on(report, code=code)[0] == "fix_code"
    assert verdict_on(report, code=code.replace("Mine", "Other"))[0] == "fix_test"


def test_a_verdict_that_is_not_left_to_try_gives_way() -> None:
    assert verdict_on(MISUSED, verdicts="fix_code")[0] == "fix_code"


TASK = {
    "task-name": "put-away",
    "task-description": "Put the red box and the blue box on the green zone.",
    "assets-used": ["proxy/red_box_1.urdf", "proxy/blue_box_1.urdf", "zone/zone-template.urdf"],
}


def test_a_solved_program_that_leaves_out_what_the_words_move_is_at_fault() -> None:
    scene = rich_scene()
    code = simulation_for(TASK, scene)
    moved = "\nobjects:\n  proxy/red_box_1.urdf #3 (0.400, -0.300, 0.025) -> (0.500, 0.100, 0.025)"
    report = WRONG_COUNT + moved
    assert "proxy/blue_box_1.urdf" in verdict_on(report, task=TASK, scene=scene, code=code)[1]
    assert verdict_on(report, task=TASK, scene=scene, code=code)[0] == "fix_code"
    both = report + "\n  proxy/blue_box_1.urdf #4 (0.420, 0.060, 0.020) -> (0.500, 0.200, 0.020)"
    assert verdict_on(both, task=TASK, scene=scene, code=code)[0] == "fix_test"
