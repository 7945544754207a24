"""Whether tests have teeth: they test the audited program, pass every time, and fail where the task is broken."""

import ast
from collections.abc import Iterator, Sequence
from typing import Final, Protocol

from grs_agents.audit.mutants import Mutant, MutantKind
from grs_agents.audit.reach_checks import find_runtime_accesses
from grs_agents.audit.source_checks import ProgramSource, read_source
from grs_agents.audit.types import Finding

RUNS: Final = 5
"""How often a suite must pass in all: a coin flip passes five times in 3 % of the cases."""
SCORE: Final = 0.8
"""Share of the mutants of a kind that make the suite fail, mean over the kinds: of five, a suite may be blind to one,
e.g. where the words leave open to within 5 cm where a thing goes."""
_MOVED: Final[tuple[MutantKind, ...]] = ("target_moved", "put_beside", "exchanged")
_BLIND: Final[dict[MutantKind, str]] = {
    "undone": "they pass although all is put back once the goals are met: they never look where things end",
    "put_beside": "they never say by themselves what things are to end in or on",
    "exchanged": "they never say which of the things is to end where",
}
"""What tests are blind to that pass for every mutant of a kind."""
_ALIVE: Final = ("passed", "not_run")
_MOCKING: Final = frozenset(
    {"mock", "pytest_mock", "MagicMock", "Mock", "AsyncMock", "patch", "monkeypatch", "setattr"}
)
_RUNTIME: Final = frozenset({"Environment", "Task", "Oracle"})


class SuiteRun(Protocol):
    """What came of one run of the suite; see the tool ``probe_tests``."""

    ended: str  # how
    test: str  # the test that ended it
    message: str  # why
    solved: int  # episodes of the audited instance at full reward
    difference: str  # how the last scene differs from the audited instance
    replaced: str  # a method of the runtime that was replaced
    held: bool  # whether the audited instance's goals hold at the end of each episode


def find_test_integrity_faults(tests: str, names: Sequence[str] = ("task_code",)) -> Iterator[tuple[int, str]]:
    """What makes tests test something else than the program, with the line: mocks, tasks of their own, no import.

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
        if fault := _describe_mock_or_own_task(node):
            yield getattr(node, "lineno", 1), fault
    yield from find_runtime_accesses(source)


def find_runtime_accesses_of_program(simulation: str) -> Iterator[tuple[int, str]]:
    """Where the simulation program reaches into what tests and measures it, with the line."""
    source = read_source("simulation", simulation)
    if isinstance(source, ProgramSource):
        yield from ((line, f"in the simulation program {reach}") for line, reach in find_runtime_accesses(source))


def _describe_mock_or_own_task(node: ast.AST) -> str:
    if isinstance(node, ast.alias) and set(node.name.split(".")) & _MOCKING:
        return f"they import {node.name}, which puts something else in place of what is tested"
    if isinstance(node, ast.ImportFrom) and set((node.module or "").split(".")) & _MOCKING:
        return f"they import from {node.module}, which puts something else in place of what is tested"
    if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id in _MOCKING:
        return f"they call {node.func.id}, which may put something else in place of what is tested"
    if isinstance(node, ast.ClassDef):
        bases = {getattr(base, "attr", getattr(base, "id", "")) for base in node.bases}
        if own := bases & _RUNTIME:
            return f"{node.name} is a {min(own)} of their own"
    return ""


def check_tests_exercise_program(faults: Sequence[tuple[int, str]], runs: Sequence[SuiteRun]) -> Finding:
    """They test the program: nothing is mocked, and an episode at full reward ran the instance that was audited."""
    told = [f"line {line}: {fault}" for line, fault in faults]
    told += [f"{name} was replaced while they ran" for name in sorted({run.replaced for run in runs} - {""})[:1]]
    solved = sum(run.solved for run in runs)
    if not solved:
        seen = sorted({run.difference for run in runs} - {""})[:1]
        told += ["no episode of theirs solved the task instance that was audited"]
        told += [f"the last scene they set up differs from it in: {difference}" for difference in seen]
    otherwise = f"{solved} episodes at full reward ran the audited task instance"
    bound = "tests must import task_code, replace nothing, and let the oracle solve what the program sets up"
    return Finding.from_fault_list("tests_of_program", told, otherwise, bound)


def check_tests_pass_repeatedly(runs: Sequence[SuiteRun]) -> Finding:
    """They pass every time, whatever the generators draw."""
    failed = [run for run in runs if run.ended != "passed"]
    measured = f"the tests passed {1 + len(runs) - len(failed)} of {1 + len(runs)} times"
    if failed:
        measured += f"; {failed[0].test or 'the suite'} {failed[0].ended}: {failed[0].message}"
    return Finding(check="tests_repeat", passed=not failed, measured=measured, bound="each time they must")


def check_tests_fail_on_mutants(mutants: Sequence[Mutant], runs: Sequence[SuiteRun]) -> Finding:
    """They fail for most mutants, and for one at least of each kind that no honest tests are blind to.

    One whose target was moved and that still ends as it should is none.

    Args:
        mutants: the faults.
        runs: of the suite, one for each.
    """
    pairs = list(zip(mutants, runs, strict=True))
    counted = [(one, run) for one, run in pairs if one.kind != "undone" and not (one.kind in _MOVED and run.held)]
    alive = _list_surviving_mutants(counted)
    blind = [words for kind, words in _BLIND.items() if _notices_none_of_kind(pairs, kind)]
    score = _mean_killed_share_by_kind(counted)
    measured = (
        f"{len(counted) - len(alive)} of {len(counted)} mutants of the task make the tests fail, score {score:.2f}"
    )
    if alive:
        measured += f"; they pass although {'; although '.join(alive)}"
    measured += "".join(f"; {words}" for words in blind)
    bound = f"at least {SCORE} must, and of some kinds one in any case; assert of every object of the task that it is "
    bound += "there, moved, and ends in its place"
    return Finding(check="tests_have_teeth", passed=score >= SCORE and not blind, measured=measured, bound=bound)


def _notices_none_of_kind(pairs: Sequence[tuple[Mutant, SuiteRun]], kind: MutantKind) -> bool:
    """Whether the suite passes for all mutants of a kind of which there are some."""
    passed = [run.ended in _ALIVE for one, run in pairs if one.kind == kind and not (kind in _MOVED and run.held)]
    return bool(passed) and all(passed)


def _list_surviving_mutants(pairs: Sequence[tuple[Mutant, SuiteRun]]) -> list[str]:
    return [one.what for one, run in pairs if run.ended in _ALIVE]


def _mean_killed_share_by_kind(counted: Sequence[tuple[Mutant, SuiteRun]]) -> float:
    """Share of the mutants of a kind that make the suite fail, mean over the kinds, 0..1."""
    killed: dict[str, list[bool]] = {}
    for one, run in counted:
        killed.setdefault(one.kind, []).append(run.ended not in _ALIVE)
    return sum(sum(row) / len(row) for row in killed.values()) / max(1, len(killed))
