"""Entry point of ``grs``: run the command line and report errors."""

import contextlib
import errno
import gc
import io
import logging
import os
import re
import resource
import sys
import traceback
from collections.abc import Sequence
from typing import Any, NoReturn, TextIO, cast

from grs_agents.base import interrupts
from grs_agents.base.errors import GrsError, InputError, suggest_name
from grs_agents.base.files import check_path_name, convert_system_error
from grs_agents.base.terminal import VERBOSITY, EscapingFormatter, print_escaped
from grs_agents.runs.deferred_imports import defer_unused_imports

_FEWEST_FILES = 256
"""Open files required. The sandbox's processes use file numbers from 128 upwards."""
_FULL = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EIO)
_COLLECTED_AFTER = 20_000
"""Threshold of the garbage collector, objects; imports alone create hundreds of thousands that stay."""
_NO_CHOICE = re.compile(r"'([^']*)' is not one of ((?:'[\w-]+'(?:, )?)+)")
_INTERRUPTED = 130
"""Exit status after Ctrl-C, as in shells."""


def main() -> None:
    """Run the command line. A user's error is a line on stderr and exit status 2; an internal error is 3 with
    traceback.

    SIGTERM interrupts like Ctrl-C.
    """
    interrupts.install_signal_handlers()
    _open_standard_streams()
    gc.set_threshold(_COLLECTED_AFTER)
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # for small matrices its threads only wait for each other
    defer_unused_imports()
    VERBOSITY.set("normal")
    try:
        _run_and_exit()
    finally:
        _flush_standard_output()


def _run_and_exit() -> NoReturn:
    try:
        from grs_agents.cli.commands import app

        if logging.lastResort is not None:
            logging.lastResort.setFormatter(EscapingFormatter())
        _require_open_files()
        _check_arguments(sys.argv[1:])
        sys.exit(_run_command_line(app))
    except GrsError as error:
        _exit_with_line(error)
    except OSError as error:
        if error.filename is None and error.errno in _FULL:
            _flush_standard_output()
            _exit_with_line(_unwritable_output_error(error))
        if refused := convert_system_error(error):
            _exit_with_line(refused)
        _exit_with_traceback(error)
    except KeyboardInterrupt:
        sys.exit(_INTERRUPTED)
    except Exception as error:
        _exit_with_traceback(error)


def _open_standard_streams() -> None:
    """Reopen closed standard streams, so that no opened file takes their place, and escape unencodable characters."""
    for number in range(3):
        try:
            os.fstat(number)
        except OSError:  # the shell has closed it: ``>&-``
            os.open(os.devnull, os.O_RDWR)
    # Python sets a closed stream to None
    sys.stdout = cast(TextIO | None, sys.stdout) or os.fdopen(1, "w")
    sys.stderr = cast(TextIO | None, sys.stderr) or os.fdopen(2, "w")
    if isinstance(sys.stdout, io.TextIOWrapper):
        sys.stdout.reconfigure(errors="backslashreplace")  # as standard error does by itself


def _flush_standard_output() -> None:
    """Flush, or exit with a line that gives the reason of the failure."""
    try:
        sys.stdout.flush()
    except OSError as error:
        with contextlib.suppress(OSError):  # keeps Python from flushing again at exit
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        if error.errno == errno.EPIPE:  # ``| head``
            sys.exit(1)
        _exit_with_line(_unwritable_output_error(error))


def _unwritable_output_error(error: OSError) -> InputError:
    return InputError(f"cannot write the output: {error.strerror}", "free space on the disk, or send it elsewhere")


def _require_open_files() -> None:
    """Raise a low limit on open files. Raises InputError: the system does not allow that."""
    lowest, highest = resource.getrlimit(resource.RLIMIT_NOFILE)
    if highest != resource.RLIM_INFINITY and highest < _FEWEST_FILES:
        raise InputError(
            f"this shell allows {highest} open files, and grs needs {_FEWEST_FILES}", "raise the limit: ulimit -n 1024"
        )
    if lowest != resource.RLIM_INFINITY and lowest < _FEWEST_FILES:
        resource.setrlimit(resource.RLIMIT_NOFILE, (_FEWEST_FILES, highest))


def _exit_with_line(error: GrsError) -> NoReturn:
    _print_error(f"grs: {error}\n")
    if VERBOSITY.get() == "verbose":
        _print_error("".join(traceback.format_exception(error)))
    sys.exit(error.exit_status)


def _exit_with_traceback(error: Exception) -> NoReturn:
    """Report an internal error and exit."""
    _print_error(f"grs: {type(error).__name__}: {error}; report it with this traceback:\n")
    _print_error("".join(traceback.format_exception(error)))
    sys.exit(GrsError.exit_status)


def _print_error(text: str) -> None:
    try:
        print_escaped(text, error=True, end="", flush=True)
    except OSError:  # a second flush by Python at exit would change the exit status
        with contextlib.suppress(OSError):
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stderr.fileno())


def _check_arguments(arguments: Sequence[str]) -> None:
    """Refuse empty arguments and invalid paths."""
    for number, argument in enumerate(arguments, start=1):
        option, _, value = argument.partition("=") if argument.startswith("--") else ("", "", argument)
        shown = f"argument {number}" + (f" ({arguments[number - 2]} ...)" if number > 1 else "")
        if argument == "" or (option and argument.endswith("=") and not value):
            raise InputError(f"{shown} is empty", "give a value, or leave the option out")
        check_path_name(value, shown)


def _run_command_line(app: Any) -> int:
    """Run the verb. Errors of the command line are printed, with a suggestion for a misspelt choice."""
    from typer.exceptions import Abort, TyperException

    try:
        # Shell completion needs this name, however the program was started.
        return int(app(prog_name="grs", standalone_mode=False) or 0)
    except TyperException as error:
        message = io.StringIO()
        with contextlib.redirect_stderr(message):
            cast(Any, error).show()
        text = message.getvalue()
        refused = _NO_CHOICE.search(text)
        suggestion = suggest_name(refused[1], refused[2].replace("'", "").split(", ")) if refused else ""
        _print_error(f"{text.rstrip()} {suggestion.strip().capitalize()}\n" if suggestion else text)
        return error.exit_code
    except Abort:
        return 1
