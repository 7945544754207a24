"""Run the ``grs`` command, and report whatever ends it early."""

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
"""Open files that the shell must allow. The sandbox's processes number some of theirs from 128 upwards."""
_FULL = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EIO)
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
    _open_standard_streams()
    _reduce_startup_cost()
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
    """Let nothing that a verb opens become standard output, and let text be written that its encoding lacks."""
    for number in range(3):
        try:
            os.fstat(number)
        except OSError:  # the shell has closed it: ``>&-``
            os.open(os.devnull, os.O_RDWR)
    # Python leaves None where a stream was closed
    sys.stdout = cast(TextIO | None, sys.stdout) or os.fdopen(1, "w")
    sys.stderr = cast(TextIO | None, sys.stderr) or os.fdopen(2, "w")
    if isinstance(sys.stdout, io.TextIOWrapper):
        sys.stdout.reconfigure(errors="backslashreplace")  # as standard error does by itself


def _flush_standard_output() -> None:
    """Write what is left, or exit with the line that says why it cannot be written."""
    try:
        sys.stdout.flush()
    except OSError as error:
        with contextlib.suppress(OSError):  # or Python would try once more
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        if error.errno == errno.EPIPE:  # ``| head``: who closes a pipe knows that there is more
            sys.exit(1)
        _exit_with_line(_unwritable_output_error(error))


def _unwritable_output_error(error: OSError) -> InputError:
    return InputError(f"cannot write the output: {error.strerror}", "free space on the disk, or send it elsewhere")


def _require_open_files() -> None:
    """Raise the limit on open files as far as it is too low. Raises InputError: the system does not allow that."""
    lowest, highest = resource.getrlimit(resource.RLIMIT_NOFILE)
    if highest != resource.RLIM_INFINITY and highest < _FEWEST_FILES:
        raise InputError(
            f"this shell allows {highest} open files, and grs needs {_FEWEST_FILES}", "raise the limit: ulimit -n 1024"
        )
    if lowest != resource.RLIM_INFINITY and lowest < _FEWEST_FILES:
        resource.setrlimit(resource.RLIMIT_NOFILE, (_FEWEST_FILES, highest))


def _reduce_startup_cost() -> None:
    """Settings of this process that cost nothing but would have to be made before its imports."""
    gc.set_threshold(_COLLECTED_AFTER)
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # for matrices this small its threads only wait for one another
    defer_unused_imports()


def _exit_with_line(error: GrsError) -> NoReturn:
    _print_error(f"grs: {error}\n")
    if VERBOSITY.get() == "verbose":
        _print_error("".join(traceback.format_exception(error)))
    sys.exit(error.exit_status)


def _exit_with_traceback(error: Exception) -> NoReturn:
    """Print an error of ours and end."""
    _print_error(f"grs: {type(error).__name__}: {error}; report it with this traceback:\n")
    _print_error("".join(traceback.format_exception(error)))
    sys.exit(GrsError.exit_status)


def _print_error(text: str) -> None:
    try:
        print_escaped(text, error=True, end="", flush=True)
    except OSError:  # where nobody can be told, the exit status says enough; Python would try once more and change it
        with contextlib.suppress(OSError):
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stderr.fileno())


def _check_arguments(arguments: Sequence[str]) -> None:
    """See that every argument can be the name of something."""
    for number, argument in enumerate(arguments, start=1):
        option, _, value = argument.partition("=") if argument.startswith("--") else ("", "", argument)
        shown = f"argument {number}" + (f" ({arguments[number - 2]} ...)" if number > 1 else "")
        if argument == "" or (option and argument.endswith("=") and not value):
            raise InputError(f"{shown} is empty", "give a value, or leave the option out")
        check_path_name(value, shown)


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
        _print_error(_suggest_choice(message.getvalue()))
        return error.exit_code
    except Abort:
        return 1
