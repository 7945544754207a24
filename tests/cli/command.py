"""The ``grs`` command, run inside the test's process: its imports, and those of its sandbox, are paid for once."""

import contextlib
import io
import sys
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from unittest.mock import patch

import typer.main

from grs_agents.base import content
from grs_agents.cli.entry import main
from grs_agents.runs.sandbox_setup import open_sandbox
from tests.kept_sandbox import lend_sandbox

_build_command = cache(typer.main.get_command)
"""Typer builds its thirty commands anew each time that it is called, which a process of its own does once."""


@dataclass(frozen=True)
class Done:
    """What a command did: its exit status and what it printed."""

    returncode: int
    stdout: str
    stderr: str


def grs(*arguments: str, folder: Path, own_sandbox: bool = False) -> Done:
    """Run ``grs`` with ``arguments`` in ``folder``; unless it is to have its own, in a sandbox that others use too."""
    lend = open_sandbox if own_sandbox else lend_sandbox
    out, err = io.StringIO(), io.StringIO()
    status = 0
    with (
        contextlib.chdir(folder),
        contextlib.redirect_stdout(out),
        contextlib.redirect_stderr(err),
        patch.object(sys, "argv", ["grs", *arguments]),
        patch.object(typer.main, "get_command", _build_command),
        patch.object(content, "_overlays", list(content._overlays)),
        patch("grs_agents.runs.execution.open_sandbox", lend),
        patch("grs_agents.runs.program_check.open_sandbox", lend),
    ):
        try:
            main()
        except SystemExit as end:
            status = int(end.code or 0)
    return Done(status, out.getvalue(), err.getvalue())
