"""Run the ``grs`` command, and report whatever ends it early."""

import contextlib
import errno
import gc
import io
import logging
import os
import re
import sys
import traceback
from collections.abc import Sequence
from typing import Any, cast

from grs_agents import interrupts
from grs_agents.errors import GrsError, InputError, suggest_name
from grs_agents.runs import defer_unused_imports
from grs_agents.terminal import VERBOSITY, EscapingFormatter, print_escaped

_LONGEST_PATH = 4096
"""Bytes; no system takes a longer path."""
_UNUSABLE = (errno.ENAMETOOLONG, errno.ELOOP, errno.ENOTDIR, errno.EISDIR, errno.EACCES, errno.EPERM)
"""What the system says of a path that somebody named; nothing of ours is missing then."""

_COLLECTED_AFTER = 20_000
"""New containers until the collector of cycles looks at them; imports alone make hundreds of thousands that stay."""
_NO_CHOICE = re.compile(r"'([^']*)' is not one of ((?:'[\w-]+'(?:, )?)+)")
_INTERRUPTED = 130
"""Exit status, as shells give it for Ctrl-C."""


def main() -> None:
    """Run the command line; a user's error is one line on stderr and exit status 2, ours is 3 with its traceback.

    A request to end (SIGTERM) is an interruption like Ctrl-C.
    """
    interrupts.install_signal_handlers()
    _reduce_startup_cost()
    VERBOSITY.set("normal")
    try:
        from grs_agents.cli.commands import app

        if logging.lastResort is not None:
            logging.lastResort.setFormatter(EscapingFormatter())
        _check_arguments(sys.argv[1:])
        sys.exit(_run_command_line(app))
    except GrsError as error:
        print_escaped(f"grs: {error}", error=True)
        if VERBOSITY.get() == "verbose":
            print_escaped("".join(traceback.format_exception(error)), error=True, end="")
        sys.exit(error.exit_status)
    except OSError as error:
        if error.filename is None or error.errno not in _UNUSABLE:
            _exit_with_traceback(error)
        print_escaped(
            f"grs: cannot use {str(error.filename)[:200]}: {error.strerror}; name another file or folder", error=True
        )
        sys.exit(InputError.exit_status)
    except KeyboardInterrupt:
        sys.exit(_INTERRUPTED)
    except Exception as error:
        _exit_with_traceback(error)


def _reduce_startup_cost() -> None:
    """Settings of this process that cost nothing but would have to be made before its imports."""
    gc.set_threshold(_COLLECTED_AFTER)
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # for matrices this small its threads only wait for one another
    defer_unused_imports()


def _exit_with_traceback(error: Exception) -> None:
    """Print an error of ours and end."""
    print_escaped(f"grs: {type(error).__name__}: {error}; report it with this traceback:", error=True)
    print_escaped("".join(traceback.format_exception(error)), error=True, end="")
    sys.exit(GrsError.exit_status)


def _check_arguments(arguments: Sequence[str]) -> None:
    """See that every argument can be the name of something."""
    for number, argument in enumerate(arguments, start=1):
        option, _, value = argument.partition("=") if argument.startswith("--") else ("", "", argument)
        shown = f"argument {number}" + (f" ({arguments[number - 2]} ...)" if number > 1 else "")
        if argument == "" or (option and argument.endswith("=") and not value):
            raise InputError(f"{shown} is empty", "give a value, or leave the option out")
        if len(value) > _LONGEST_PATH:
            remedy = f"give at most {_LONGEST_PATH}; put long settings into a file and name it with --config"
            raise InputError(f"{shown} has {len(value)} characters", remedy)
        if any("\ud800" <= letter <= "\udfff" for letter in argument):
            raise InputError(f"{shown} is not UTF-8: {argument}", "rename the file, or set the locale to UTF-8")


def _suggest_choice(message: str) -> str:
    """``message``; where it refuses one of a few words, with the one that was probably meant."""
    refused = _NO_CHOICE.search(message)
    meant = suggest_name(refused[1], refused[2].replace("'", "").split(", ")) if refused else ""
    return f"{message.rstrip()} {meant.strip().capitalize()}\n" if meant else message


def _run_command_line(app: Any) -> int:
    """Run the verb, and say what is wrong with the command line if something is."""
    from typer.exceptions import Abort, TyperException

    try:
        # The name by which shells ask for completion, however the program was started.
        return int(app(prog_name="grs", standalone_mode=False) or 0)
    except TyperException as error:
        message = io.StringIO()
        with contextlib.redirect_stderr(message):
            cast(Any, error).show()
        print_escaped(_suggest_choice(message.getvalue()), error=True, end="")
        return error.exit_code
    except Abort:
        return 1
