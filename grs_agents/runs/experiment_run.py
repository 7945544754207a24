"""Common parts of experiments: options, stored rows, progress, and results with their provenance."""

import argparse
import hashlib
import json
from collections.abc import Callable, Collection, Generator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from contextlib import contextmanager
from dataclasses import dataclass
from datetime import date
from pathlib import Path
from typing import Any, Final, Generic, TypeVar

from pydantic import BaseModel
from rich.console import RenderableType
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

from grs_agents.base import Frozen
from grs_agents.base.config.load import flatten_tree, load_config
from grs_agents.base.config.schema import Config
from grs_agents.base.content import hash_code
from grs_agents.base.errors import InputError
from grs_agents.base.files import write_json
from grs_agents.base.foreign.files import read_json
from grs_agents.base.terminal import EscapingParser, make_console, print_json
from grs_agents.base.version import __version__
from grs_agents.runs.metrics import Figure, figures_table, metrics_table, metrics_to_dicts

RESULT: Final = "result.json"
_OF_NO_ROW: Final = ("out", "config", "settings", "json", "workers")
"""Options without influence on rows; the configuration itself is compared instead of the options that set it."""
_Row = TypeVar("_Row", bound=BaseModel)


class _Measured(Frozen):
    """The figures of a measurement."""

    figures: tuple[Figure, ...]


class ExperimentParser(EscapingParser):
    """A parser with the common options ``--out``, ``--config``, ``--set`` and ``--json``."""

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
            arguments: command line after the experiment's name.
            settings: default settings of the experiment for these options; ``--set`` overrides them.

        Raises:
            ConfigError: the configuration cannot be read.
        """
        options = self.parse_args(arguments)
        defaults = settings(options) if settings is not None else ()
        effective = load_config(options.config, [*defaults, *options.settings])
        leaves = flatten_tree(effective.config.model_dump(mode="json"))
        changed = [key for key, source in effective.sources.items() if source.startswith(("file ", "--set"))]
        changes = tuple(f"{key}={json.dumps(leaves[key])}" for key in changed if leaves[key] is not None)
        return Experiment(self._name, tuple(arguments), options, effective.config, changes)


@dataclass(frozen=True)
class Experiment:
    """A running experiment.

    Attributes:
        name: as after ``grs eval``.
        arguments: its command line.
        options: the parsed command line.
        config: the configuration.
        settings: its changes by files and options as ``KEY=VALUE``, for worker processes.
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
        """Compute the missing rows behind a progress bar, and store them in ``--out``.

        Args:
            kind: the type of a row. Rows with a non-empty ``error`` are not stored.
            work: function that computes each row, by name.
            workers: number of rows computed in parallel.
            choosing: options that select rows without changing them.
            show: the line to print for a new row.

        Raises:
            InputError: ``--out`` holds rows of other options or another configuration.
        """
        options = {key: value for key, value in vars(self.options).items() if key not in (*_OF_NO_ROW, *choosing)}
        stored = open_stored_rows(self.options.out, kind, {"config": self.config, "options": options})
        rows = {name: stored.rows[name] for name in work if name in stored.rows}
        with show_progress(self.name, len(work), len(rows)) as advance:

            def store(name: str, row: _Row) -> None:
                rows[name] = row
                if not getattr(row, "error", ""):
                    stored.keep(name, row)
                advance(name, "" if show is None else show(row))

            run_jobs_in_threads([name for name in work if name not in rows], lambda name: work[name](), store, workers)
        return [rows[name] for name in work]

    def measure(self, work: Mapping[str, Callable[[], Sequence[Figure]]]) -> list[Figure]:
        """The figures of all measurements in order; stored measurements are not repeated."""
        rows = self.make_or_reuse_rows(
            _Measured,
            {name: lambda measure=measure: _Measured(figures=tuple(measure())) for name, measure in work.items()},
        )
        return [figure for row in rows for figure in row.figures]

    def tell(self, table: Sequence[Mapping[str, Any]], *shown: RenderableType, **more: Any) -> None:
        """Write ``result.json`` to ``--out``; print it with ``--json``, else print ``shown``.

        Args:
            table: rows of the results, with the same columns each.
            shown: output on the terminal.
            more: further results.
        """
        results = {"table": [dict(row) for row in table], **more}
        seeds = {key: value for key, value in vars(self.options).items() if key in ("seed", "seeds", "runs")}
        provenance = {
            "experiment": self.name,
            "arguments": self.arguments,
            "date": date.today().isoformat(),
            "grs-agents": __version__,
            "seeds": {"seed": self.config.seed, **seeds},
        }
        write_json(self.options.out / RESULT, {**provenance, **results})
        if self.options.json:
            print_json(results)
            return
        console = make_console()
        for item in shown:
            console.print(item, soft_wrap=isinstance(item, str))

    def tell_figures(self, title: str, figures: Sequence[Figure], **more: Any) -> int:
        """Report measured quantities as `tell` does. Returns: exit status, 1 if a target is missed."""
        shown = metrics_table(title, figures)
        self.tell(figures_table(figures), shown, figures=metrics_to_dicts(figures), **more)
        return 1 if any(figure.is_target_met is False for figure in figures) else 0


@contextmanager
def show_progress(title: str, total: int, done: int = 0) -> Generator[Callable[[str, str], None]]:
    """A progress bar on standard error. The yielded function advances it, with a name beside it and a line above it."""
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
    jobs: Sequence[_Job], work: Callable[[_Job], _Outcome], store: Callable[[_Job, _Outcome], None], workers: int = 1
) -> None:
    """Do ``work`` for each job and pass the outcomes, as they come, to ``store`` in this thread.

    A single worker is this thread itself. An interruption waits only for started jobs.
    """
    if workers == 1:
        for job in jobs:
            store(job, work(job))
        return
    with ThreadPoolExecutor(workers) as pool:
        futures = {pool.submit(work, job): job for job in jobs}
        try:
            for future in as_completed(futures):
                store(futures[future], future.result())
        finally:
            pool.shutdown(wait=False, cancel_futures=True)


class StoredRows(Generic[_Row]):
    """Rows of an interrupted or finished experiment by name, in ``rows.json`` of its folder."""

    def __init__(self, file: Path, digest: str, rows: dict[str, _Row]) -> None:
        self.file, self.digest, self.rows = file, digest, rows

    def keep(self, name: str, row: _Row) -> None:
        """Store a row, unless the name is stored already."""
        if name not in self.rows:
            self.rows[name] = row
            rows = {name: row.model_dump(mode="json") for name, row in self.rows.items()}
            write_json(self.file, {"of": self.digest, "rows": rows}, durable=True)


def open_stored_rows(folder: Path, kind: type[_Row], of: Mapping[str, Any]) -> StoredRows[_Row]:
    """Open the rows stored in ``folder``.

    Args:
        folder: output folder of the experiment; it need not exist.
        kind: the type of a row.
        of: the configuration and options on which the rows depend.

    Raises:
        InputError: the stored rows are of other code, another configuration or other options.
    """
    parts = {
        key: part.model_dump(mode="json") if isinstance(part, BaseModel) else str(part) for key, part in of.items()
    }
    digest = hashlib.sha256(json.dumps([hash_code(), parts], sort_keys=True).encode()).hexdigest()
    file = folder / "rows.json"
    if not file.is_file():
        return StoredRows(file, digest, {})
    remedy = "name another --out"
    stored = read_json(file, remedy)
    if stored.get("of") != digest:
        raise InputError(f"{file} holds rows of other code, another configuration or other options", remedy)
    return StoredRows(file, digest, {name: kind.model_validate(row) for name, row in stored["rows"].items()})
