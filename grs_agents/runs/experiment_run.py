"""What every experiment does alike: options, rows that are kept, progress, and results with how they came about."""

import argparse
import json
from collections.abc import Callable, Collection, Generator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from contextlib import contextmanager
from dataclasses import dataclass
from datetime import date
from pathlib import Path
from typing import Any, Final, TypeVar

from pydantic import BaseModel
from rich.console import RenderableType
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

from grs_agents.base import Frozen
from grs_agents.base.config.load import flatten_tree, load_config
from grs_agents.base.config.schema import Config
from grs_agents.base.files import write_json
from grs_agents.base.terminal import EscapingParser, make_console, print_json
from grs_agents.base.version import __version__
from grs_agents.runs.kept_rows import open_stored_rows
from grs_agents.runs.metrics import Figure, figures_table, metrics_table, metrics_to_dicts

RESULT: Final = "result.json"
_OF_NO_ROW: Final = ("out", "config", "settings", "json", "workers")
"""Options that change no row; the configuration itself is compared instead of the options that make it."""
_Row = TypeVar("_Row", bound=BaseModel)


class _Measured(Frozen):
    """The figures that one measurement gives."""

    figures: tuple[Figure, ...]


class ExperimentParser(EscapingParser):
    """A parser with the options of every experiment: ``--out``, ``--config``, ``--set`` and ``--json``."""

    def __init__(self, name: str, about: str | None) -> None:
        super().__init__(prog=f"grs eval {name}", description=about)
        self._name = name
        out = Path(f"runs/eval-{name}")
        self.add_argument("--out", type=Path, default=out, help=f"where rows and results go ({out}): it goes on there")
        self.add_argument("--config", type=Path, default=None, metavar="FILE", help="a TOML configuration file")
        self.add_argument("--set", action="append", default=[], dest="settings", metavar="KEY=VALUE")
        self.add_argument("--json", action="store_true", help="print the results as JSON; progress goes to stderr")

    def start(
        self, arguments: Sequence[str], settings: Callable[[argparse.Namespace], Sequence[str]] | None = None
    ) -> "Experiment":
        """Read the command line and the configuration.

        Args:
            arguments: what follows the experiment's name.
            settings: settings of the experiment's own for what was asked; those of ``--set`` win over them.

        Raises:
            ConfigError: the configuration cannot be read.
        """
        options = self.parse_args(arguments)
        own = settings(options) if settings is not None else ()
        effective = load_config(options.config, [*own, *options.settings])
        leaves = flatten_tree(effective.config.model_dump(mode="json"))
        stated = [key for key, source in effective.sources.items() if source.startswith(("file ", "--set"))]
        told = tuple(f"{key}={json.dumps(leaves[key])}" for key in stated if leaves[key] is not None)
        return Experiment(self._name, tuple(arguments), options, effective.config, told)


@dataclass(frozen=True)
class Experiment:
    """An experiment under way.

    Attributes:
        name: as after ``grs eval``.
        arguments: its command line.
        options: what that says.
        config: the configuration.
        settings: what files and options say of it as ``KEY=VALUE``, for work in processes of their own.
    """

    name: str
    arguments: tuple[str, ...]
    options: argparse.Namespace
    config: Config
    settings: tuple[str, ...]

    def make_or_reuse_rows(
        self,
        kind: type[_Row],
        work: Mapping[str, Callable[[], _Row]],
        *,
        workers: int = 1,
        choosing: Collection[str] = (),
        show: Callable[[_Row], str] | None = None,
    ) -> list[_Row]:
        """Make the row of each name behind a bar, and keep it in ``--out``; one that is kept there is not made again.

        Args:
            kind: the type of a row. One whose ``error`` is not empty is not kept.
            work: what makes each row, by its name.
            workers: rows at a time.
            choosing: options that say which rows are made, and not what is in them.
            show: the line to print for a new row.

        Raises:
            InputError: ``--out`` holds rows of other options or another configuration.
        """
        depends = {key: value for key, value in vars(self.options).items() if key not in (*_OF_NO_ROW, *choosing)}
        kept = open_stored_rows(self.options.out, kind, {"config": self.config, "options": depends})
        rows = {name: kept.rows[name] for name in work if name in kept.rows}
        with show_progress(self.name, len(work), len(rows)) as advance:

            def keep(name: str, row: _Row) -> None:
                rows[name] = row
                if not getattr(row, "error", ""):
                    kept.keep(name, row)
                advance(name, "" if show is None else show(row))

            run_jobs_in_threads([name for name in work if name not in rows], lambda name: work[name](), keep, workers)
        return [rows[name] for name in work]

    def measure(self, work: Mapping[str, Callable[[], Sequence[Figure]]]) -> list[Figure]:
        """The figures of each measurement, one after the other; those that are kept are not measured again."""
        rows = self.make_or_reuse_rows(
            _Measured, {name: lambda one=one: _Measured(figures=tuple(one())) for name, one in work.items()}
        )
        return [figure for row in rows for figure in row.figures]

    def tell(self, table: Sequence[Mapping[str, Any]], *shown: RenderableType, **more: Any) -> None:
        """Write ``result.json`` to ``--out``, and print it with ``--json``, otherwise what is to be ``shown``.

        Args:
            table: the results for people, a row each, all with the same columns.
            shown: what the terminal shows.
            more: everything else that there is to tell.
        """
        told = {"table": [dict(row) for row in table], **more}
        seeds = {key: value for key, value in vars(self.options).items() if key in ("seed", "seeds", "runs")}
        came = {
            "experiment": self.name,
            "arguments": self.arguments,
            "date": date.today().isoformat(),
            "grs-agents": __version__,
            "seeds": {"seed": self.config.seed, **seeds},
        }
        write_json(self.options.out / RESULT, {**came, **told})
        if self.options.json:
            print_json(told)
            return
        console = make_console()
        for one in shown:
            console.print(one, soft_wrap=isinstance(one, str))

    def tell_figures(self, title: str, figures: Sequence[Figure], **more: Any) -> int:
        """Tell measured quantities with their bounds, as `tell` does. Returns the exit status: 1 if one is missed."""
        shown = metrics_table(title, figures)
        self.tell(figures_table(figures), shown, figures=metrics_to_dicts(figures), **more)
        return 1 if any(figure.is_target_met is False for figure in figures) else 0


@contextmanager
def show_progress(title: str, total: int, done: int = 0) -> Generator[Callable[[str, str], None]]:
    """A bar on standard error. What it yields moves the bar on by one, with a name beside it and a line above it."""
    columns = [BarColumn(), MofNCompleteColumn(), TimeElapsedColumn(), TimeRemainingColumn()]
    with Progress(TextColumn("{task.description}"), *columns, console=make_console(error=True)) as progress:
        bar = progress.add_task(title, total=total, completed=done)

        def advance(name: str, line: str = "") -> None:
            if line:
                progress.console.print(line, soft_wrap=True, highlight=False)
            progress.update(bar, advance=1, description=name)

        yield advance


_Job = TypeVar("_Job")
_Outcome = TypeVar("_Outcome")


def run_jobs_in_threads(
    jobs: Sequence[_Job], work: Callable[[_Job], _Outcome], keep: Callable[[_Job, _Outcome], None], workers: int = 1
) -> None:
    """Do ``work`` for each job and hand the outcomes to ``keep``, in this thread, as they come.

    One worker is this thread itself. An interrupt waits only for those that have begun.
    """
    if workers == 1:
        for job in jobs:
            keep(job, work(job))
        return
    with ThreadPoolExecutor(workers) as pool:
        futures = {pool.submit(work, job): job for job in jobs}
        try:
            for future in as_completed(futures):
                keep(futures[future], future.result())
        finally:
            pool.shutdown(wait=False, cancel_futures=True)
