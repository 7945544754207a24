"""The router: errors of the tests go to the tests, all else to the program."""

import pytest

from tests.models.roles import verdict_on

SHORT = (
    "failed: 1 of 3 tests passed\nTestX.test_a: failed (raised in tests): 0.5 != 1.0\n"
    "  AssertionError: 0.5 != 1.0\n  oracle: outcome=step_limit reward=0.50 steps=3/3 detail=step limit: 1 of 2 "
    'objects placed objects=["HOPE/Milk.urdf"]'
)
MISUSED = (
    "failed: 2 of 3 tests passed\nTestX.test_a: error (raised in tests): 'dict' object is not callable\n"
    "  TypeError: 'dict' object is not callable\n  oracle: outcome=success reward=1.00 steps=2/5 detail=done objects=[]"
)
RAISED = (
    "error: 0 of 0 tests passed; the program cannot be imported\nraised in: simulation\n"
    "  NameError: name 'np' is not defined"
)
IMPORT = "error: 0 of 0 tests passed\nraised in: tests\n  ImportError: cannot import name 'X' from 'task_code'"
AUDIT = "passed: 3 of 3 tests passed\n\naudit: failed\n- moved: FAILED: objects moved: [1]; at least 2 must"


@pytest.mark.parametrize(
    ("report", "verdict", "told"),
    [
        (SHORT, "fix_code", "step_limit"),
        (MISUSED, "fix_test", "not callable"),
        (RAISED, "fix_code", "NameError"),
        (IMPORT, "fix_test", "ImportError"),
        (AUDIT, "fix_code", "moved"),
        ("no_tests: 0 of 0 tests passed", "fix_test", "no tests"),
        ("failed: 0 of 1 tests passed\nTestX.test_a: no_assertion", "fix_test", "check nothing"),
        ("load_tests: 0 of 0 tests passed", "fix_test", "load_tests"),
        ("failed: 0 of 1 tests passed\nTestX.test_a: missing (raised in tests): gone", "fix_test", "missing"),
        ("tampered: 0 of 1 tests passed\nTestX.test_a: tampered (raised in tests): changed", "fix_test", "tampered"),
        ("failed: 0 of 1 tests passed\nTestX.test_a: limit (raised in simulation): much", "fix_code", ""),
        ("", "fix_code", ""),
    ],
)
def test_verdicts(report: str, verdict: str, told: str) -> None:
    said, explanation = verdict_on(report)
    assert said == verdict
    assert told in explanation


def test_three_fixes_of_the_tests_in_vain_are_enough() -> None:
    history = "1. fix_test: x\n2. fix_test: x\n3. fix_test: x"
    assert verdict_on(MISUSED, history)[0] == "fix_code"
