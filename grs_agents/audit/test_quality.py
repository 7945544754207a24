"""Checks of the tests: they exercise the audited program, pass every time, and fail on mutants of the task."""

import ast
from collections.abc import Iterator, Sequence
from typing import Final, Protocol

from grs_agents import sim
from grs_agents.audit.mutants import Mutant, MutantKind
from grs_agents.audit.source_checks import ProgramSource, read_source
from grs_agents.audit.types import AuditFinding

RUNS: Final = 5
"""How often a suite must pass in all: a coin flip passes five times in 3 % of the cases."""
SCORE: Final = 0.8
"""Least mutation score: share of mutants that make the suite fail, averaged over their kinds. A suite may miss a kind
in five, e.g. if the task's text fixes a position only to 5 cm."""
_MOVED: Final[tuple[MutantKind, ...]] = ("target_moved", "put_beside", "exchanged")
_BLIND: Final[dict[MutantKind, str]] = {
    "undone": "they pass although all is put back once the goals are met: they never look where things end",
    "put_beside": "they never say by themselves what things are to end in or on",
    "exchanged": "they never say which of the things is to end where",
}
"""Blind spots of tests that pass for every mutant of a kind."""
_ALIVE: Final = ("passed", "not_run")
_MOCKING: Final = frozenset(
    {"mock", "pytest_mock", "MagicMock", "Mock", "AsyncMock", "patch", "monkeypatch", "setattr"}
)
_RUNTIME: Final = frozenset({"Environment", "Task", "Oracle"})

# fmt: off
_INTERPRETER_MODULES: Final = {
    "_thread", "atexit", "builtins", "ctypes", "dis", "faulthandler", "gc", "importlib", "inspect", "marshal",
    "mmap", "multiprocessing", "pickle", "pkgutil", "resource", "runpy", "shelve", "signal", "socket", "sqlite3",
    "subprocess", "tempfile", "threading", "tracemalloc", "types", "weakref",
}
"""Modules that show or change an interpreter, or persist state between runs."""
_RUNTIME_NAMES: Final = {
    "witness", "Probe", "EpisodeMemory", "EpisodeReplay", "RememberingOracle", "set_environment_defaults",
    "reset_before_test", "_getframe", "_current_frames", "f_back", "f_locals", "f_globals", "gi_frame", "tb_frame",
    "tb_next", "__globals__", "__subclasses__", "__builtins__", "__dict__", "__mro__", "modules", "settrace",
    "setprofile", "_exit", "mj_step", "attrgetter", "methodcaller", "__getattribute__",
}
# fmt: on
"""Names that lead there."""
_SHARED: Final = "a test has to run its own, to full reward; one that setUpClass or setUpModule runs does not count"
IN_PROGRAM: Final = "in the simulation program"
"""Begin of faults that are the program's, not the tests'."""
_CALLED: Final = frozenset({"exec", "eval", "compile", "__import__", "globals", "vars", "open"})


class SuiteRun(Protocol):
    """Outcome of a run of the suite; see the tool ``probe_tests``."""

    ended: str  # how
    test: str  # the test that ended it
    message: str  # why
    solved: int  # episodes of the audited instance at full reward
    difference: str  # how the last scene differs from the audited instance
    replaced: str  # a method of the runtime that was replaced
    held: bool  # the audited instance's goals hold at the end of each episode


def find_test_integrity_faults(tests: str, names: Sequence[str] = ("task_code",)) -> Iterator[tuple[int, str]]:
    """Find mocks, tasks defined by the tests themselves and missing imports of the program.

    Args:
        tests: their source.
        names: the modules that the program can be imported as.
    """
    source = read_source("tests", tests)
    if not isinstance(source, ProgramSource):
        yield source.line, source.message
        return
    imports = {alias.name for node in source.nodes_of_type(ast.Import) for alias in node.names}
    imports |= {node.module or "" for node in source.nodes_of_type(ast.ImportFrom)}
    if not imports & set(names):
        yield 1, f"they never import {names[0]}"
    for node in source.nodes:
        fault = ""
        if isinstance(node, ast.alias) and set(node.name.split(".")) & _MOCKING:
            fault = f"they import {node.name}, which puts something else in place of what is tested"
        elif isinstance(node, ast.ImportFrom) and set((node.module or "").split(".")) & _MOCKING:
            fault = f"they import from {node.module}, which puts something else in place of what is tested"
        elif isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id in _MOCKING:
            fault = f"they call {node.func.id}, which may put something else in place of what is tested"
        elif isinstance(node, ast.ClassDef):
            bases = {getattr(base, "attr", getattr(base, "id", "")) for base in node.bases}
            if runtime := bases & _RUNTIME:
                fault = f"{node.name} is a {min(runtime)} of their own"
        if fault:
            yield getattr(node, "lineno", 1), fault
    yield from _find_runtime_accesses(source)


def find_runtime_accesses_of_program(simulation: str) -> Iterator[tuple[int, str]]:
    """Find accesses of the simulation program to the runtime that tests and measures it.

    Returns: pairs of line and fault.
    """
    source = read_source("simulation", simulation)
    if isinstance(source, ProgramSource):
        yield from ((line, f"{IN_PROGRAM} {reach}") for line, reach in _find_runtime_accesses(source))


def _find_runtime_accesses(source: ProgramSource) -> Iterator[tuple[int, str]]:
    """Find accesses to the runtime, as the source shows them; no task and no test needs any.

    Code in the same interpreter can still hide an access with enough effort. Returns: pairs of line and fault.
    """
    imported = {
        alias.asname or alias.name.split(".")[0]
        for node in source.nodes
        if isinstance(node, ast.Import | ast.ImportFrom)
        for alias in node.names
    }
    for node in source.nodes:
        if reach := _describe_runtime_access(node, imported):
            yield getattr(node, "lineno", 1), reach


def _describe_runtime_access(node: ast.AST, imported: set[str]) -> str:
    if isinstance(node, ast.Import | ast.ImportFrom):
        modules = [alias.name for alias in node.names] if isinstance(node, ast.Import) else [node.module or ""]
        for name in modules:
            inner = name.startswith("grs_agents") and name not in ("grs_agents", sim.__name__)
            if inner or name.split(".")[0] in _INTERPRETER_MODULES:
                return f"it imports {name}"
        taken = {alias.name for alias in node.names} if isinstance(node, ast.ImportFrom) else set[str]()
        packages = {"sandbox", "graph", "audit", "run"} if modules == ["grs_agents"] else set[str]()
        hidden = sorted(taken & (_RUNTIME_NAMES | _INTERPRETER_MODULES | packages))
        return f"it imports {hidden[0]}" if hidden else ""
    name = node.attr if isinstance(node, ast.Attribute) else node.value if isinstance(node, ast.Constant) else ""
    if isinstance(name, str) and name in _RUNTIME_NAMES:
        return f"{name} leads to what runs and measures it"
    if isinstance(node, ast.Call) and isinstance(node.func, ast.Name):
        called = node.func.id
        computed = called == "getattr" and len(node.args) > 1 and not isinstance(node.args[1], ast.Constant)
        if computed or called in _CALLED:
            return "it calls getattr with a name that it computes" if computed else f"it calls {called}"
    if isinstance(node, ast.Attribute | ast.Subscript) and not isinstance(node.ctx, ast.Load):
        root: ast.expr = node  # of `a.b[c].d`
        while isinstance(root, ast.Attribute | ast.Subscript):
            root = root.value
        if isinstance(root, ast.Name) and root.id in imported:
            return f"it changes {root.id}, which is not its own"
    return ""


def check_tests_exercise_program(faults: Sequence[tuple[int, str]], runs: Sequence[SuiteRun]) -> AuditFinding:
    """They test the program: nothing is mocked, and an episode at full reward ran the instance that was audited."""
    lines = [f"line {line}: {fault}" for line, fault in faults]
    lines += [f"{name} was replaced while they ran" for name in sorted({run.replaced for run in runs} - {""})[:1]]
    solved = sum(run.solved for run in runs)
    if not solved:
        seen = sorted({run.difference for run in runs} - {""})[:1]
        cause = f"the last scene they set up differs from it in: {seen[0]}" if seen else _SHARED
        lines += [f"no episode of theirs solved the task instance that was audited: {cause}"]
    otherwise = f"{solved} episodes at full reward ran the audited task instance"
    bound = "tests must import task_code, replace nothing, and let the oracle solve what the program sets up"
    return AuditFinding.from_fault_list("tests_of_program", lines, otherwise, bound)


def check_tests_pass_repeatedly(runs: Sequence[SuiteRun]) -> AuditFinding:
    """The tests pass on every run, for any random draws."""
    failed = [run for run in runs if run.ended != "passed"]
    measured = f"the tests passed {1 + len(runs) - len(failed)} of {1 + len(runs)} times"
    if failed:
        measured += f"; {failed[0].test or 'the suite'} {failed[0].ended}: {failed[0].message}"
    return AuditFinding(check="tests_repeat", passed=not failed, measured=measured, bound="each time they must")


def check_tests_fail_on_mutants(mutants: Sequence[Mutant], runs: Sequence[SuiteRun]) -> AuditFinding:
    """The tests fail for most mutants, and for at least a mutant of each kind in ``_BLIND``.

    A mutant with a moved target whose audited goals still hold at the end does not count.

    Args:
        mutants: the faults.
        runs: of the suite, for each mutant.
    """
    pairs = list(zip(mutants, runs, strict=True))
    counted = [
        (mutant, run) for mutant, run in pairs if mutant.kind != "undone" and not (mutant.kind in _MOVED and run.held)
    ]
    alive = [mutant.what for mutant, run in counted if run.ended in _ALIVE]
    blind: list[str] = []
    for kind, words in _BLIND.items():
        of_kind = [(mutant, run) for mutant, run in pairs if mutant.kind == kind]
        passed = [run.ended in _ALIVE for _, run in of_kind if not (kind in _MOVED and run.held)]
        if passed and all(passed):
            blind.append(words)
    killed: dict[str, list[bool]] = {}
    for mutant, run in counted:
        killed.setdefault(mutant.kind, []).append(run.ended not in _ALIVE)
    score = sum(sum(row) / len(row) for row in killed.values()) / max(1, len(killed))
    failing = f"{len(counted) - len(alive)} of {len(counted)}"
    measured = f"{failing} mutants of the task make the tests fail, score {score:.2f}"
    if alive:
        measured += f"; they pass although {'; although '.join(alive)}"
    measured += "".join(f"; {words}" for words in blind)
    bound = f"at least {SCORE} must, and of some kinds one in any case; assert of every object of the task that it is "
    bound += "there, moved, and ends in its place"
    return AuditFinding(check="tests_have_teeth", passed=score >= SCORE and not blind, measured=measured, bound=bound)
