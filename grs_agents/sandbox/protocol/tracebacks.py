"""Tracebacks of generated programs: only the frames that help, and in which file the error was raised."""

import os
import re
import sysconfig
import traceback
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, TypeVar

SIMULATION_FILE = "task_code.py"
TESTS_FILE = "test_task_code.py"
"""The names generated programs have in tracebacks; the module names are the paper's."""

MAX_MESSAGE, MAX_TRACEBACK, MAX_OUTPUT = 1000, 8000, 4000
"""Characters of the texts of a test case."""

_PROGRAMS = (SIMULATION_FILE, TESTS_FILE)

RaisedIn = Literal["simulation", "tests", "library"]
_MACHINERY = (str(Path(__file__).parent.parent), str(Path(traceback.__file__).parent / "unittest"))
_FOLDERS = sorted({str(Path(__file__).parents[3]), *sysconfig.get_paths().values()} - {os.sep}, key=len, reverse=True)
"""Folders of this package, its siblings and the standard library."""
_Frame = TypeVar("_Frame")
_FRAME = re.compile(r'^ {2}File "(?P<file>[^"]*)", line (?P<line>[0-9]{1,9}) in (?P<function>.{0,200})$')
"""The program can write to the pipe of the dump too: text outside these bounds is no frame."""


@dataclass(frozen=True)
class Trace:
    """A traceback as text."""

    message: str  # the exception's type and text, in a single line
    text: str  # the traceback, innermost frame last, without the frames of unittest and the sandbox
    raised_in: RaisedIn  # the file of the innermost frame that belongs to a generated program, else `library`
    functions: tuple[str, ...] = ()  # the functions that were running, innermost last


def describe_error(error: BaseException) -> Trace:
    """The traceback of ``error``, causes included."""
    whole = traceback.TracebackException.from_exception(error, limit=-40)
    current: traceback.TracebackException | None = whole
    while current is not None:
        current.stack[:] = _relevant_frames(list(current.stack), [frame.filename for frame in current.stack])
        current = current.__cause__ or current.__context__
    lines = "".join(whole.format_exception_only()).rstrip().splitlines() or [type(error).__name__]
    # A syntax error shows its line first.
    message = next((line for line in lines if not line.startswith(" ")), lines[-1])
    files = [frame.filename for frame in whole.stack]
    if isinstance(error, SyntaxError) and error.filename in _PROGRAMS:
        files.append(error.filename)
    functions = tuple(frame.name for frame in whole.stack)
    text = shorten_paths("".join(whole.format()))
    return Trace(
        shorten_paths(message)[:MAX_MESSAGE], text[-MAX_TRACEBACK:].strip(), _innermost_program(files), functions
    )


def describe_stack_dump(stack: str, sources: Mapping[str, str], message: str) -> Trace | None:
    """A ``faulthandler`` dump as a traceback with its source lines; None if no generated code was running."""
    code = {file: source.splitlines() for file, source in sources.items()}
    for section in re.split(r"\n\s*\n", stack):
        frames = [match for line in section.splitlines() if (match := _FRAME.match(line))]
        frames.reverse()
        frames = _relevant_frames(frames, [frame["file"] for frame in frames])
        if not frames or frames[0]["file"] not in _PROGRAMS:
            continue
        lines = ["Traceback (most recent call last):"]
        for frame in frames:
            lines.append(f'  File "{frame["file"]}", line {frame["line"]}, in {frame["function"]}')
            number = int(frame["line"])
            lines.extend(f"    {line.strip()}" for line in code.get(frame["file"], [])[max(number - 1, 0) : number])
        files = [frame["file"] for frame in frames]
        functions = tuple(frame["function"] for frame in frames)
        return Trace(
            message, shorten_paths("\n".join([*lines, message]))[-MAX_TRACEBACK:], _innermost_program(files), functions
        )
    return None


def shorten_paths(text: str) -> str:
    """A text without the paths of this machine: files of libraries begin with the name of their package."""
    here = str(Path.cwd())
    for folder in (*_FOLDERS, *([here] if here != os.sep else [])):
        text = text.replace(f"{folder}{os.sep}", "")
    return text


def _relevant_frames(frames: list[_Frame], files: list[str]) -> list[_Frame]:
    """The frames from the first generated program on, without those of unittest and the sandbox."""
    first = next((index for index, file in enumerate(files) if file in _PROGRAMS), 0)
    both = zip(frames[first:], files[first:], strict=True)
    return [frame for frame, file in both if not file.startswith((*_MACHINERY, "<"))]


def _innermost_program(files: list[str]) -> RaisedIn:
    for file in reversed(files):
        if file == SIMULATION_FILE:
            return "simulation"
        if file == TESTS_FILE:
            return "tests"
    return "library"
