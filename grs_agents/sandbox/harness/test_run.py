"""The child's side of a test run: load the program and its tests, run them one by one, report each at once."""

import ast
import contextlib
import importlib
import linecache
import random
import sys
import unittest
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from pathlib import Path
from types import CodeType, ModuleType
from typing import Any, cast

from grs_agents.sandbox.harness.assertion_count import COUNTER, Counter, counted
from grs_agents.sandbox.harness.captured_error import Caught
from grs_agents.sandbox.harness.results import Result, Session, TamperedError, report
from grs_agents.sandbox.harness.tampering import Integrity, overridden
from grs_agents.sandbox.protocol.tracebacks import SIMULATION_FILE, TESTS_FILE, RaisedIn, describe


def run_tests_inside(request: dict[str, Any]) -> dict[str, Any]:
    """Run the tests ``request["items"]``; each start and end is a progress event of the item.

    Args:
        request: the fields of ``TestRun``, and ``items``, the ids of the tests to run.

    Returns:
        ``{"load_error": None, "found": [...]}`` with the ids of the tests that were there once all was loaded, or what
        went wrong before any test could run.

    Raises:
        MemoryError, TamperedError: what still runs in this process cannot be trusted; what ran before was reported.
    """
    seed = int(request["seed"])
    seed_everything(seed)
    counter, tests, found = Counter(), ModuleType("test_task_code"), list[str]()
    integrity = Integrity(with_numpy="testing" in request["simulation"] + request["tests"])
    with Caught() as caught:
        load_program(request["simulation"], request["simulation_name"])
        _check(integrity, "simulation")
        tests = _load_tests(request["tests"], counter)
        _check(integrity, "tests")
        found = _found(tests)
    if isinstance(caught.error, MemoryError):
        raise caught.error
    if caught.error is not None:
        return {"load_error": _load_error(caught.error)}
    begin = partial(_begin, seed, _hook(request["clear"]))
    session = Session(begin, _hook(request["episode"]), _hook(request["limit"]), counter, integrity)
    _run(tests, list(request["items"]), session)
    if session.spoilt is not None:
        raise session.spoilt
    return {"load_error": None, "found": found}


def load_program(source: str, alias: str = "", file: str = SIMULATION_FILE) -> ModuleType:
    """Execute ``source`` as the module named after ``file``, also known as ``alias`` unless a module has that name.

    The file is written to the working folder, where programs that read their own source find it.

    Raises:
        BaseException: whatever the program raises.
    """
    return _execute(compile(source, file, "exec"), source, alias, file, {})


def seed_everything(seed: int) -> None:
    """Seed the global generators that programs written for CLIPort draw from."""
    import numpy as np  # here, so that a worker that runs no program starts without it

    random.seed(seed)
    np.random.seed(seed % 2**32)


def _load_tests(source: str, counter: Counter) -> ModuleType:
    """Execute the test program with its assertions counted."""
    code = compile(counted(ast.parse(source, TESTS_FILE)), TESTS_FILE, "exec")
    return _execute(code, source, "", TESTS_FILE, {COUNTER: counter.reached})


def _execute(code: CodeType, source: str, alias: str, file: str, given: dict[str, object]) -> ModuleType:
    name = file.removesuffix(".py")
    module = ModuleType(name)
    module.__file__ = file
    Path(file).write_text(source, "utf-8")
    linecache.cache[file] = (len(source), None, source.splitlines(keepends=True), file)
    sys.modules[name] = module
    if alias:
        sys.modules.setdefault(alias, module)
    vars(module).update(given)
    exec(code, module.__dict__)
    return module


def _check(integrity: Integrity, loaded: RaisedIn) -> None:
    """See that the program just ``loaded`` left the machinery as it was."""
    broken = integrity.broken()
    if broken is not None:
        message, where = broken
        raise TamperedError(message, where or loaded)


def _load_error(error: BaseException) -> dict[str, Any]:
    trace = describe(error)
    kind = "error"
    if isinstance(error, TamperedError):
        message, where = error.args
        return {"kind": "tampered", "message": message, "traceback": "", "raised_in": where}
    if isinstance(error, SystemExit):
        kind = "exited"
    return {"kind": kind, "message": trace.message, "traceback": trace.text, "raised_in": trace.raised_in}


def _found(tests: ModuleType) -> list[str]:
    """The ids of the tests that the loaded module has; a class under several names counts once."""
    kinds = {
        name: kind for name, kind in list(vars(tests).items())
        if isinstance(kind, type) and issubclass(kind, unittest.TestCase) and kind.__name__ == name
    }  # fmt: skip
    return [
        f"{name}.{method}"
        for name, kind in kinds.items()
        for method in dir(kind)
        if method.startswith("test") and callable(getattr(kind, method, None))
    ][:1000]


def _run(tests: ModuleType, pending: list[str], session: Session) -> None:
    """Run ``pending`` until each has ended or nothing more can."""
    while pending and session.spoilt is None:
        result = Result(session)
        suite = unittest.TestSuite(_cases(tests, pending, session))
        if suite.countTestCases():
            with contextlib.suppress(KeyboardInterrupt):  # unittest lets it through; the tests after it still run
                suite.run(result)
        left = [item for item in pending if item not in session.ended]
        if len(left) == len(pending):
            result.blame_fixture(left)
            return
        pending = left


def _begin(seed: int, clear: Callable[[], Any]) -> None:
    seed_everything(seed)
    clear()


def _hook(name: str | None) -> Callable[..., Any]:
    if not name:
        return lambda: None
    module, _, function = name.partition(":")
    return cast(Callable[..., Any], getattr(importlib.import_module(module), function))


def _cases(tests: ModuleType, items: Sequence[str], session: Session) -> Iterator[unittest.TestCase]:
    """The test cases of ``items`` that the loaded module really has, and that are run as unittest runs tests."""
    for item in items:
        owner, _, method = item.partition(".")
        kind = getattr(tests, owner, None)
        if isinstance(kind, type) and issubclass(kind, unittest.TestCase) and callable(getattr(kind, method, None)):
            own = overridden(kind)
            if own is None:
                case = kind(method)
                session.names[id(case)] = item
                yield case
            else:
                message = f"{own} takes the place of unittest's own"
                report(item, outcome="tampered", message=message, raised_in="tests")
                session.ended.add(item)
