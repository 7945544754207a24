"""Hostile programs get what they are told, and the world outside is as it was."""

import pkgutil
from importlib import import_module
from pathlib import Path
from types import ModuleType

import pytest

from tests.sandbox.attacks.conftest import EVERY, Door, Make
from tests.sandbox.attacks.kit import Attack
from tests.slow import SLOW

FOLDER = Path(__file__).parent / "programs"
PROGRAMS = {
    info.name: import_module(f"tests.sandbox.attacks.programs.{info.name}")
    for info in pkgutil.iter_modules([str(FOLDER)])
}


def attacks(program: ModuleType) -> dict[str, Attack]:
    """The attacks in a program, by their names."""
    return {name: thing for name, thing in vars(program).items() if isinstance(thing, Attack)}


def cases(attack: Attack) -> list[str | None]:
    """The cases of an attack, or all together where none may get anything: then none ends the process of the others."""
    if not attack.cases:
        return [None]
    return [EVERY] if attack.answers == ("nothing",) and not attack.limits else list(attack.cases)


ATTACKS = [
    pytest.param(program, name, case, id=f"{room}-{name}" + (f"-{case}" if case else ""), marks=[SLOW] * (index > 0))
    for room, program in PROGRAMS.items()
    for name, attack in attacks(program).items()
    for index, case in enumerate(cases(attack))
]
"""Each attack in each of its cases; those after the first are slow."""


def test_there_are_attacks_enough() -> None:
    assert sum(len(attacks(program)) for program in PROGRAMS.values()) >= 45


@pytest.mark.parametrize(("program", "name", "case"), ATTACKS)
def test_attack(program: ModuleType, name: str, case: str | None, make: Make) -> None:
    got, answers = make(program, name, case), attacks(program)[name].answers
    assert got in answers


def test_the_worker_is_as_good_as_before(door: Door) -> None:
    result = door.execute("print('hello'); value = {'got': 1 + 1}")
    assert (result.outcome, result.value, result.output) == ("ok", {"got": 2}, "hello\n")
