"""``grs suite`` and ``grs evaluate``."""

import tempfile
from collections.abc import Generator, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn
from rich.table import Table
from rich.text import Text

from grs_agents.base import terminal
from grs_agents.base.errors import InputError
from grs_agents.base.files import check_output_path, write_file_or_stdout, write_text
from grs_agents.base.foreign.run_folder import REMEDY, is_relative_subpath
from grs_agents.base.ray_cluster import Engine
from grs_agents.base.tables import write_table
from grs_agents.base.terminal import print_escaped, print_json
from grs_agents.runs.batch.results import RESULTS
from grs_agents.runs.batch.results import read_results as read_batch_results
from grs_agents.sim.variation.types import Variation
from grs_agents.tasks.suites.evaluation import (
    EpisodeResult,
    EvaluationSummary,
    compare_evaluations,
    evaluate,
    make_order,
    read_results,
)
from grs_agents.tasks.suites.layouts import read_layout
from grs_agents.tasks.suites.statistics import PairedComparison
from grs_agents.tasks.suites.suite import list_changes_of_suite, make_suite
from grs_agents.views.common.foreign_decoding import decode_in_worker
from grs_agents.views.evaluation.episodes import find_episode, make_episode_shot
from grs_agents.views.evaluation.page import render_evaluation_page
from grs_agents.views.film.rollout_film import HIGH_DEFINITION, SUFFIXES, RolloutShot, write_film
from grs_agents.views.terminal import show_activity_status


def write_suite(
    folder: Path,
    runs: Sequence[Path],
    name: str | None,
    instances: int,
    variation: Variation,
    grade: bool,
    workers: int,
    as_json: bool,
) -> int:
    """Make a suite of runs and print its tasks."""
    with show_activity_status("making the suite") as show:
        suite = make_suite(
            folder,
            list(_list_runs(runs)),
            name or folder.resolve().name,
            instances,
            variation,
            grade,
            workers=workers,
            show=show,
        )
    if as_json:
        print_json({"folder": str(folder), **suite.model_dump(mode="json", exclude={"tasks": {"__all__": {"files"}}})})
        return 0
    console = terminal.make_console()
    table = Table(box=None, pad_edge=False, header_style="bold", title=f"{folder}: {len(suite.tasks)} tasks")
    for column in ("task", "robot", "instances", "moves", "difficulty", "tags", "words"):
        table.add_column(column, overflow="fold")
    for task in suite.tasks:
        difficulty = "" if task.difficulty is None else f"{task.difficulty:.2f}"
        row = (
            task.name,
            f"{task.robot}, {task.hand}",
            str(len(task.seeds)),
            str(task.moves),
            difficulty,
            ", ".join(task.tags),
        )
        table.add_row(*map(Text, (*row, task.words["default"])))
    console.print(table)
    return 0


def _list_runs(folders: Sequence[Path]) -> Iterator[Path]:
    """The folders; a batch stands for its accepted runs, of equal tasks the first."""
    for folder in folders:
        if not (folder / RESULTS).is_file():
            yield folder
            continue
        for row in read_batch_results(folder).rows:
            if row.status == "accepted" and not row.repeats:
                if not is_relative_subpath(row.run):
                    raise InputError(f"{folder / RESULTS} names the run {row.run[:200]!r}", REMEDY)
                yield folder / row.run


def verify_suite_folder(folder: Path, as_json: bool) -> int:
    """Compare a suite's files with their hashes. Returns: exit status, 1 if any differs."""
    changes = list_changes_of_suite(folder)
    if as_json:
        print_json({"status": "differs" if changes else "holds", "differences": list(changes)})
        return int(bool(changes))
    console = terminal.make_console()
    for line in changes:
        console.print(Text(line))
    count = len(changes)
    verdict = (
        f"does not hold, {count} difference{'s' * (count > 1)}" if changes else "holds: every file is as it was made"
    )
    console.print(Text(f"{folder}: {verdict}", style="bold"))
    return int(bool(changes))


def evaluate_policy(
    folder: Path,
    policy: str,
    layout: str,
    out: Path | None,
    workers: int,
    engine: Engine,
    address: str | None,
    settings: dict[str, Any],
    as_json: bool,
) -> int:
    """Evaluate a policy with a progress bar, and print its figures."""
    order = make_order(folder, policy, read_layout(layout), **settings)
    name = "".join(letter if letter.isalnum() else "-" for letter in policy).strip("-")[:60]
    place = out or folder.resolve().with_name(f"{folder.resolve().name}-{name}")
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    with Progress(*columns, console=terminal.make_console(error=True)) as progress:
        row = progress.add_task("episodes")

        def update_episode_progress(done: int, total: int) -> None:
            progress.update(row, completed=done, total=total)

        try:
            summary = evaluate(folder, order, place, workers, update_episode_progress, engine, address)
        except KeyboardInterrupt:
            print_escaped("interrupted; the same command goes on", error=True)
            raise
    rows = [row.model_dump(mode="json") for row in read_results(place)]
    write_table(place / "episodes", tuple(EpisodeResult.model_fields), rows)
    with show_activity_status("drawing films") as show:
        write_text(place / "index.html", render_evaluation_page(folder, place, show))
    if as_json:
        print_json({"folder": str(place), **summary.model_dump(mode="json")})
        return 0
    _print_summary(place, summary)
    return 0


def open_episode_viewer(out: Path, suite: Path | None, name: str, web: bool, as_json: bool) -> int:
    """Open the rerun viewer on an episode of the evaluation in ``out``."""
    from grs_agents.cli.show import open_viewer_and_wait
    from grs_agents.views.rerun.episode_view import record_episode

    with tempfile.TemporaryDirectory() as temporary:
        with _decoded_episode(out, suite, name) as (shot, row):
            recording = record_episode(shot, row, Path(temporary) / "episode.rrd")
        return open_viewer_and_wait(recording, web, as_json)


def write_episode_as_file(
    out: Path, suite: Path | None, name: str, file: Path | None, large: bool, as_json: bool
) -> None:
    """Write an episode of the evaluation in ``out`` as a recording or a film, by the suffix of ``file``."""
    if file is None or file.suffix.lower() not in (*SUFFIXES, ".rrd"):
        endings = ", ".join((*SUFFIXES, ".rrd"))
        raise InputError(f"cannot write an episode as {file}", f"name a file with --out that ends in one of {endings}")
    from grs_agents.views.rerun.episode_view import record_episode

    check_output_path(file)
    with show_activity_status("drawing the episode") as show, _decoded_episode(out, suite, name) as (shot, row):
        if file.suffix.lower() == ".rrd":
            with tempfile.TemporaryDirectory() as temporary:
                recording = record_episode(shot, row, Path(temporary) / "episode.rrd")
                write_file_or_stdout(file, recording.read_bytes())
        else:
            width, height = HIGH_DEFINITION if large else (shot.width, shot.height)
            write_film(replace(shot, width=width, height=height), file, show=show)
    if as_json:
        print_json({"file": str(file), "bytes": file.stat().st_size})
    else:
        print_escaped(f"{file}: {file.stat().st_size / 2**20:.1f} MiB")


@contextmanager
def _decoded_episode(out: Path, suite: Path | None, name: str) -> Generator[tuple[RolloutShot, EpisodeResult]]:
    """An episode, with the pictures and motions of both folders decoded in a worker."""
    if suite is None:
        raise InputError("--episode needs the suite of the evaluation", "name its folder with --suite")
    row = find_episode(suite, out, name)
    with decode_in_worker(out, suite):
        yield make_episode_shot(suite, out, row), row


def print_paired_comparison(first: Path, second: Path, as_json: bool) -> int:
    """Compare two evaluations of one suite."""
    compared = compare_evaluations(first, second)
    if as_json:
        print_json(compared.model_dump(mode="json"))
        return 0
    terminal.make_console().print(Text(describe_comparison(compared, first.name, second.name)))
    return 0


def describe_comparison(compared: PairedComparison, first: str, second: str) -> str:
    """A paired comparison in words."""
    return (
        f"{second} against {first}: {100 * compared.difference:+.1f} points of success "
        f"({100 * compared.low:+.1f} to {100 * compared.high:+.1f}, 95 %, clustered by task) in {compared.episodes} "
        f"paired episodes; only {second} solves {compared.only_second}, only {first} {compared.only_first} "
        f"(McNemar p = {compared.p_value:.2g})"
    )


def _print_effects(console: Console, summary: EvaluationSummary) -> None:
    table = Table(box=None, pad_edge=False, header_style="bold")
    for column in ("factor", "success alone", "95 %", "episodes", "log odds", "95 %", "effect"):
        table.add_column(column, overflow="fold")
    for effect in summary.effects:
        alone, odds = effect.alone, effect.log_odds
        rate, bounds = (f"{alone.mean:.0%}", f"{alone.low:.0%} to {alone.high:.0%}") if alone.count else ("", "")
        change = (f"{odds.value:+.1f}", f"{odds.low:+.1f} to {odds.high:+.1f}", effect.verdict)
        table.add_row(*map(Text, (effect.factor, rate, bounds, str(alone.count), *change)))
    console.print(table)
    if summary.together is not None:
        console.print(Text(f"with all factors: success {summary.together.mean:.1%} of {summary.together.count}"))


def _print_summary(place: Path, summary: EvaluationSummary) -> None:
    console = terminal.make_console()
    rate = summary.success
    figure = f"{rate.mean:.1%} ({rate.low:.1%} to {rate.high:.1%}) of {rate.count}"
    console.print(Text(f"{summary.policy} on {summary.suite}: success {figure}", style="bold"))
    table = Table(box=None, pad_edge=False, header_style="bold")
    for column in ("", "success", "95 %", "episodes", "progress"):
        table.add_column(column, overflow="fold")
    groups = [(task.task, task.success, f"{task.progress:.0%}") for task in summary.tasks]
    groups += [(f"tag: {tag}", interval, "") for tag, interval in summary.by_tag.items()]
    groups += [(f"words: {words}", interval, "") for words, interval in summary.by_words.items()]
    for name, interval, progress in groups:
        bounds = f"{interval.low:.0%} to {interval.high:.0%}"
        table.add_row(*map(Text, (name, f"{interval.mean:.0%}", bounds, str(interval.count), progress)))
    console.print(table)
    if summary.effects:
        _print_effects(console, summary)
    outcomes = ", ".join(f"{count} {name.replace('_', ' ')}" for name, count in summary.outcomes.items())
    console.print(Text(f"outcomes: {outcomes}; progress {summary.progress:.0%}, at best {summary.best_progress:.0%}"))
    if summary.seconds is not None:
        console.print(
            Text(f"a solved episode takes {summary.seconds:.1f} s and {summary.path:.2f} m of the tip's path")
        )
    moved = f"{summary.disturbed:.0%} of episodes moved a bystander; {summary.dropped:.2f} objects dropped in each"
    console.print(Text(moved))
    console.print(Text(f"the page is {place / 'index.html'}, rows and motions are beside it"))
