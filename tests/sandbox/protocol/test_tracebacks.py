"""Tracebacks tell the program that raised, not the machinery that ran it."""

import linecache

import pytest

from grs_agents.sandbox.protocol.tracebacks import SIMULATION_FILE, TESTS_FILE, describe_error, describe_stack_dump

SIMULATION = "def fail(): return 1 / 0\ndef parse(): return int('x')\n"
TESTS = """\
def test(): fail()
def check(): assert False, 'why\\nnot'
def recover():
    try:
        __import__("unittest").TestCase().assertTrue(False)
    except AssertionError:
        fail()
def wrap():
    try:
        __import__("unittest").TestCase().assertTrue(False)
    except AssertionError as error:
        raise ArithmeticError from error
"""


def _raised(call: str) -> BaseException:
    scope: dict[str, object] = {}
    for file, source in ((SIMULATION_FILE, SIMULATION), (TESTS_FILE, TESTS)):
        linecache.cache[file] = (len(source), None, source.splitlines(keepends=True), file)
        exec(compile(source, file, "exec"), scope)
    with pytest.raises((ArithmeticError, AssertionError)) as info:
        eval(call, scope)
    return info.value


def test_innermost_program_is_blamed() -> None:
    trace = describe_error(_raised("test()"))
    assert (trace.raised_in, trace.message) == ("simulation", "ZeroDivisionError: division by zero")
    assert trace.functions == ("test", "fail")
    assert trace.text.splitlines()[1] == f'  File "{TESTS_FILE}", line 1, in test'
    assert "def fail(): return 1 / 0" in trace.text


def test_failed_assertion_belongs_to_the_tests() -> None:
    trace = describe_error(_raised("check()"))
    assert (trace.raised_in, trace.message) == ("tests", "AssertionError: why")


@pytest.mark.parametrize("call", ["recover()", "wrap()"])
def test_the_error_before_an_error_is_told_without_the_frames_of_unittest(call: str) -> None:
    lines = describe_error(_raised(call)).text.splitlines()
    [first] = [number for number, line in enumerate(lines) if line.startswith("AssertionError")]
    assert [line for line in lines[:first] if line.startswith("  File")] == [
        f'  File "{TESTS_FILE}", line {5 if call == "recover()" else 10}, in {call.removesuffix("()")}'
    ]


def test_no_program_means_library() -> None:
    assert describe_error(ValueError("x")).raised_in == "library"


def test_syntax_error_belongs_to_its_file() -> None:
    with pytest.raises(SyntaxError) as info:
        compile("def", SIMULATION_FILE, "exec")
    assert describe_error(info.value).raised_in == "simulation"


def test_exception_that_cannot_be_shown() -> None:
    class StrangeError(Exception):
        def __str__(self) -> str:
            raise RuntimeError

    assert "StrangeError" in describe_error(StrangeError()).message


def test_fault_handler_dump_becomes_a_traceback() -> None:
    stack = (
        "Timeout (0:00:01)!\n"
        "Thread 0x1 (most recent call first):\n"
        '  File "/lib/python3.11/re.py", line 5 in match\n'
        f'  File "{SIMULATION_FILE}", line 1 in fail\n'
        f'  File "{TESTS_FILE}", line 1 in test\n'
        '  File "/lib/python3.11/unittest/case.py", line 5 in run\n'
    )
    trace = describe_stack_dump(stack, {SIMULATION_FILE: SIMULATION, TESTS_FILE: TESTS}, "no result within 1 s")
    assert trace is not None
    assert trace.raised_in == "simulation"
    assert trace.functions == ("test", "fail", "match")
    assert "def test(): fail()" in trace.text
    assert trace.text.splitlines()[-1] == "no result within 1 s"


@pytest.mark.parametrize(
    "stack", ["", "garbage", '  File "x.py", line 99999999 in f', f'  File "{SIMULATION_FILE}", line 0 in']
)
def test_stack_without_a_program_is_none(stack: str) -> None:
    assert describe_stack_dump(stack, {}, "") is None
