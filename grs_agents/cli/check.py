"""``grs check``."""

import tempfile
from dataclasses import dataclass
from pathlib import Path

from rich.table import Table
from rich.text import Text

from grs_agents import terminal
from grs_agents.audit import AuditReport
from grs_agents.config import Config, Effective, validated
from grs_agents.run import CheckOrder, check, read_record
from grs_agents.sandbox import TestReport
from grs_agents.terminal import say_json


@dataclass(frozen=True)
class Program:
    """What is checked.

    Attributes:
        simulation: the program.
        tests: its tests, if there are any.
        run: the run whose own assets it may use.
    """

    simulation: Path
    tests: Path | None
    run: Path | None

    @classmethod
    def of(cls, named: Path, tests: Path | None, run: Path | None) -> "Program":
        """A program by its file, or the one that a run ended with, by the run's folder."""
        if not named.is_dir():
            return cls(named, tests, run)
        own = named / "test_simulation.py"
        return cls(named / "simulation.py", tests or (own if own.is_file() else None), run or named)


def check_program(program: Program, chosen: Effective, as_json: bool) -> int:
    """Check a program and print what was found.

    Returns:
        0 if its tests pass and the audit accepts it, 1 if not.

    Raises:
        InputError: a file cannot be read, or the folder holds no run.
    """
    config = _as_in(program.run, chosen) if program.run else chosen.config
    with tempfile.TemporaryDirectory(prefix="grs-check-") as folder:
        report, audit = check(CheckOrder(program.simulation, program.tests, config, Path(folder), program.run))
    accepted = audit.accepted and (report is None or report.ok)
    if as_json:
        value = {
            "status": "accepted" if accepted else "rejected",
            "tests": None if report is None else report.model_dump(mode="json"),
            "audit": audit.model_dump(mode="json"),
        }
        say_json(value)
    else:
        _print(report, audit, accepted)
    return 0 if accepted else 1


def _as_in(run: Path, chosen: Effective) -> Config:
    """The configuration with the robot and the seed of a run, where the user names none."""
    recorded = read_record(run).config
    same = {key: recorded[key] for key in ("robot", "seed") if key in recorded and chosen.sources[key] == "default"}
    return validated({**chosen.config.model_dump(), **same})


def _print(report: TestReport | None, audit: AuditReport, accepted: bool) -> None:
    console = terminal.console()
    table = Table(box=None, pad_edge=False, header_style="bold", title="accepted" if accepted else "rejected")
    for column in ("check", "result", "detail"):
        table.add_column(column, overflow="fold", no_wrap=column != "detail")
    for case in report.cases if report is not None else ():  # their class is the same for all, and long
        table.add_row(*map(Text, (case.id.rpartition(".")[2], case.outcome, case.message)))
    if report is not None and not report.cases:
        table.add_row(*map(Text, ("tests", report.outcome, report.message)))
    for finding in audit.findings:
        table.add_row(*map(Text, (finding.check, "passed" if finding.passed else "failed", finding.detail)))
    for rollout in audit.rollouts:
        episode = rollout.episode
        table.add_row(
            *map(Text, (f"seed {rollout.seed}", episode.outcome, f"reward {episode.reward:.2f}: {episode.detail}"))
        )
    for warning in dict.fromkeys(warning for rollout in audit.rollouts for warning in rollout.warnings):
        table.add_row(*map(Text, ("warning", "", warning)))
    console.print(table)
    console.print(Text(audit.about))
