"""Versions of the two programs: written to the run folder with their diffs, and logged."""

import difflib
import hashlib
from typing import Literal

from grs_agents.files import write_text
from grs_agents.nodes.services import Services, Update
from grs_agents.state import RunState
from grs_agents.trace import ProgramVersion

ProgramName = Literal["simulation", "tests"]
FILES: dict[ProgramName, str] = {"simulation": "simulation.py", "tests": "test_simulation.py"}


def new_version(state: RunState, services: Services, program: ProgramName, source: str, author: str) -> Update:
    """Keep ``source`` as the next version of ``program``: file, history, diff, event and state update."""
    old = state.get(program, "")
    number = state.get(f"{program}_version", 0) + 1
    stem = FILES[program].removesuffix(".py")
    path = f"history/{stem}_{number:03d}.py"
    diff = "".join(
        difflib.unified_diff(
            old.splitlines(keepends=True), source.splitlines(keepends=True), f"{stem} {number - 1}", f"{stem} {number}"
        )
    )
    write_text(services.folder / path, source)
    write_text(services.folder / f"history/{stem}_{number:03d}.diff", diff)
    write_text(services.folder / FILES[program], source)
    services.log.append(
        ProgramVersion(
            program=program,
            number=number,
            sha256=_hash(source),
            parent=_hash(old) if old else None,
            path=path,
            diff=diff,
            author_role=author,
            source="model",
        )
    )
    return {program: source, f"{program}_version": number}


def _hash(source: str) -> str:
    return hashlib.sha256(source.encode()).hexdigest()
