"""The verbs that look at a run that was made. Each imports what it needs when it is called."""

import sys
from pathlib import Path
from typing import Annotated

import typer

from grs_agents.cli.options import Json
from grs_agents.errors import InputError

RunFolder = Annotated[Path, typer.Argument(help="A run folder.")]


def show(
    run: RunFolder,
    step: Annotated[int | None, typer.Option("--step", help="Print one step in full.", metavar="N")] = None,
    failed: Annotated[bool, typer.Option("--failed", help="Print the last step that went wrong in full.")] = False,
    json: Json = False,
) -> None:
    """Show the steps of a run as a tree, or one of them with its exact prompts, replies, diffs and tracebacks."""
    from grs_agents.cli.show import show_run, show_step

    if step is None and not failed:
        show_run(run, json)
    else:
        show_step(run, step, json)


def replay(
    run: RunFolder,
    beside: Annotated[Path | None, typer.Argument(help="Another run to show beside it.")] = None,
    web: Annotated[bool, typer.Option("--web", help="Open the viewer in a browser.")] = False,
) -> None:
    """Open a run's trace, or two side by side, in the rerun viewer, on 127.0.0.1."""
    from grs_agents.cli.show import replay_run

    sys.exit(replay_run(run, beside, web))


def trace(
    run: Annotated[Path | None, typer.Argument(help="A run folder.")] = None,
    schema: Annotated[bool, typer.Option("--schema", help="Print the JSON schema of one event.")] = False,
    otel: Annotated[
        bool, typer.Option("--otel", help="Send the run as OpenTelemetry spans to where OTEL_* variables say.")
    ] = False,
) -> None:
    """Make a run's rerun recording anew from its events, or send it as OpenTelemetry spans."""
    from grs_agents.cli.outputs import print_schema, rebuild_trace, send_spans

    if schema:
        print_schema()
    elif otel:
        send_spans(required(run, "grs trace --otel"))
    else:
        rebuild_trace(required(run, "grs trace"))


def play(
    run: RunFolder,
    out: Annotated[
        Path | None, typer.Option("--out", help="Write a film instead of opening a window.", metavar="FILE.mp4|.gif")
    ] = None,
    seed: Annotated[
        int | None, typer.Option("--seed", help="Of the rollout to play; the first one by default.", metavar="N")
    ] = None,
) -> None:
    """Play a run's task, as the oracle solved it, in MuJoCo's window or into an mp4 or gif file."""
    from grs_agents.cli.outputs import play_run

    sys.exit(play_run(run, out, seed))


def report(
    run: RunFolder,
    out: Annotated[
        Path | None,
        typer.Option(
            "--out", help="The file, - for standard output; report.html in the run folder by default.", metavar="FILE"
        ),
    ] = None,
) -> None:
    """Write a run as one HTML page that needs nothing else: photo, task, pictures, decisions, changes, tests."""
    from grs_agents.cli.outputs import report_run

    report_run(run, out)


def share(
    run: RunFolder,
    out: Annotated[
        Path | None,
        typer.Option(
            "--out", help="The zip file, - for standard output; beside the run folder by default.", metavar="FILE.zip"
        ),
    ] = None,
) -> None:
    """Pack a run into one zip file without keys and home folders, with its recording and report."""
    from grs_agents.cli.outputs import share_run

    share_run(run, out)


def required(run: Path | None, command: str) -> Path:
    """The run folder, which must be named.

    Raises:
        InputError: it is not.
    """
    if run is None:
        raise InputError(f"{command} needs a run folder", f"{command} RUN")
    return run


def add_to(app: typer.Typer) -> None:
    """Give ``app`` these verbs."""
    for verb in (show, replay, trace, report, play, share):
        app.command()(verb)
