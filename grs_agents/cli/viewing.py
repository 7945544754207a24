"""The verbs that look at a run that was made. Each imports what it needs when it is called."""

import sys
from pathlib import Path
from typing import Annotated

import typer

from grs_agents.cli.options import Json

RunFolder = Annotated[Path, typer.Argument(help="A run folder.")]


def show(
    run: RunFolder,
    step: Annotated[int | None, typer.Option("--step", help="Print one step in full.", metavar="N")] = None,
    failed: Annotated[bool, typer.Option("--failed", help="Print the last step that went wrong in full.")] = False,
    json: Json = False,
) -> None:
    """Show the steps of a run as a tree, or one of them with its exact prompts, replies, diffs and tracebacks."""
    from grs_agents.cli.looking import show_run, show_step

    if step is None and not failed:
        show_run(run, json)
    else:
        show_step(run, step, json)


def replay(
    run: RunFolder,
    web: Annotated[bool, typer.Option("--web", help="Open the viewer in a browser.")] = False,
) -> None:
    """Open a run's trace in the rerun viewer, on 127.0.0.1."""
    from grs_agents.cli.looking import replay_run

    sys.exit(replay_run(run, web))


def add_to(app: typer.Typer) -> None:
    """Give ``app`` these verbs."""
    for verb in (show, replay):
        app.command()(verb)
