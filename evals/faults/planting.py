"""Pairs of programs with a planted fault each: read from folders, or made from right pairs by typical mistakes."""

import json
import random
import re
from pathlib import Path
from typing import Any, Literal

from evals.faults.mistakes import MISTAKES
from grs_agents.base import Frozen
from grs_agents.base.errors import InputError

BASES = Path(__file__).parent / "bases"
"""Right pairs for the sample scene: files with three fenced blocks, task, program and tests."""
_PAIR = ("simulation.py", "test_simulation.py")
"""Files of a program and its tests."""


class PlantedFault(Frozen):
    """A pair of programs with a fault in either."""

    name: str
    kind: str  # of the planted mistake
    truth: Literal["fix_code", "fix_test"]
    right_tests: bool  # the program does something other than the task, and tests of the task's words show it
    task: dict[str, Any]
    simulation: str
    tests: str
    base_tests: str  # those of the right pair
    base_order: tuple[str, ...] = ()  # assets of the movable objects in the order in which the right program adds them


def read_fault_folders(folder: Path) -> list[PlantedFault]:
    """The faults of a folder that holds ``BASE``, a right pair with its task, and beside it a folder for each fault.

    The folder of a fault holds a program and its tests, of which the one at fault differs from that of ``BASE``.

    Raises:
        InputError: ``BASE`` lacks a file, there is no fault, or a pair differs from ``BASE`` in neither or both.
    """
    base = folder / "BASE"
    for name in ("task.json", *_PAIR):
        if not (base / name).is_file():
            raise InputError(f"{folder} holds no BASE/{name}", "name a folder of planted faults")
    base_program, base_tests = ((base / name).read_text("utf-8") for name in _PAIR)
    listed = (folder / "LIST.txt").read_text("utf-8") if (folder / "LIST.txt").is_file() else ""
    kinds = dict(line.split(": ", 1) for line in listed.splitlines() if ": " in line)
    faults: list[PlantedFault] = []
    for path in sorted(folder.iterdir()):
        if path == base or not all((path / name).is_file() for name in _PAIR):
            continue
        simulation, tests = ((path / name).read_text("utf-8") for name in _PAIR)
        if (simulation == base_program) == (tests == base_tests):
            differing = "neither" if tests == base_tests else "both"
            message = f"{path} differs from BASE in {differing} of {' and '.join(_PAIR)}"
            raise InputError(message, "plant each fault in one of them")
        faults.append(
            PlantedFault(
                name=path.name,
                kind=kinds.get(path.name, ""),
                truth="fix_code" if tests == base_tests else "fix_test",
                right_tests=False,
                task=json.loads((base / "task.json").read_text("utf-8")),
                simulation=simulation,
                tests=tests,
                base_tests=base_tests,
                base_order=find_order(base_program),
            )
        )
    if not faults:
        raise InputError(f"{folder} holds no folder with {' and '.join(_PAIR)} beside BASE", "plant faults there")
    return faults


def read_base(file: Path) -> tuple[dict[str, Any], str, str]:
    """Task, program and tests of a right pair."""
    task, simulation, tests = re.findall(r"^```(?:json|python)\n(.*?)^```$", file.read_text("utf-8"), re.S | re.M)
    return json.loads(task), simulation, tests


def find_order(simulation: str) -> tuple[str, ...]:
    """The assets of the movable objects that a program adds, each once, in the order of its text."""
    added = re.findall(r"^ .*\.add_object\(\"([\w/-]+\.urdf)\"(?!.*\"fixed\")", simulation, re.M)
    return tuple(dict.fromkeys(added))


def plant_mistakes(half: int, seed: int) -> list[PlantedFault]:
    """Each kind of mistake in each right pair that it applies to; of these, every second from number ``half`` on."""
    planted: list[PlantedFault] = []
    for file in sorted(BASES.glob("*.md")):
        task, simulation, tests = read_base(file)
        for mistake in MISTAKES:
            in_program = mistake.program == "simulation"
            rng = random.Random(f"{seed} {file.stem} {mistake.name}")
            edited = mistake.apply(simulation if in_program else tests, rng)
            if edited is None:
                continue
            planted.append(
                PlantedFault(
                    name=f"{file.stem}.{mistake.program}.{mistake.name}",
                    kind=mistake.name,
                    truth="fix_code" if in_program else "fix_test",
                    right_tests=mistake.right_tests,
                    task=task,
                    simulation=edited if in_program else simulation,
                    tests=tests if in_program else edited,
                    base_tests=tests,
                    base_order=find_order(simulation),
                )
            )
    return planted[half::2]
